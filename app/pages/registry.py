"""The pages, in the order of the navigation. Adding one is a folder and one line below."""

from __future__ import annotations

from app.page import Page
from app.pages.classifier.page import ClassifierPage
from app.pages.convergence.page import ConvergencePage
from app.pages.evidence.page import EvidencePage
from app.pages.home.page import HomePage
from app.pages.infer.page import InferPage
from app.pages.learn.page import LearnPage
from app.pages.observe.page import ObservePage
from app.pages.pdf.page import PdfPage
from app.pages.profiles.page import ProfilesPage
from app.pages.simulate.page import SimulatePage
from app.pages.spectrum.page import SpectrumPage

PAGES: tuple[type[Page], ...] = (
    HomePage,
    ProfilesPage,
    PdfPage,
    EvidencePage,
    ClassifierPage,
    SpectrumPage,
    ObservePage,
    InferPage,
    LearnPage,
    SimulatePage,
    ConvergencePage,
)
"""All pages, in the navigation's order; the first is the one of a link that names none."""
