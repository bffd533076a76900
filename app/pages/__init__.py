"""The pages, one folder each; `app.pages.registry` has their order. Adding one is a folder and a line there.

How to write a page
===================
Make ``app/pages/<key>/page.py`` with a class derived from `app.page.Page`, and add the class to
`app.pages.registry.PAGES`::

    class PdfPage(Page):
        key, title, group = "pdf", "PDF", "Explore"
        question = "How often does each density occur?"
        uses = frozenset({"mass", "stream", "noise", "n_bin", "theme"})

        def view(self):
            data = self._data()
            self.opening = ui.Opening(self.question)
            self.live = LiveFigure(pdf_figure(data))            # streamdash.plots.live
            self.card = ui.FigureCard(                          # heading, figure, sentence, downloads
                "PDF of density fluctuations", self.live.figure, name="pdf",
                drawn=lambda: pdf_figure(self._data(), backend="matplotlib"),  # for files
                table=lambda: pdf_table(self._data()),          # pandas.DataFrame, units in column names
                code=lambda: pdf_code(...),                     # lines of Python that run as shown
            )
            self.card.say(pdf_sentence(data))
            return ui.page_layout(
                self.card.view,
                opening=self.opening,                           # the page's question, its answer now
                panel=ui.side_panel([ui.noise_slider(self)], [ui.ensemble_picker(self)]),
            )

        def update(self, changed):
            data = self._data()
            self.live.patch(pdf_columns(data))                  # {element label: {column: array}}
            self.card.say(pdf_sentence(data))

Rules
-----
- **Constructor**: ``(session, services)``; do no work there, `view` is called once right after. The
  shell closes the page and builds it anew when its structure must change: when ``stream`` or
  ``mass`` (the compared ensembles) change. `update` is called for every other name in `uses`,
  inside ``pn.io.hold()``. A page watches the session only through `Page.bind`, which `close` undoes.
- **State** is a field (`app.session.fields`) of `app.session.session.Session` or, where it is one page's,
  of the class in its ``state.py``: bounds, default and words are declared there and nowhere else. Then it
  is in the URL, checked, and survives leaving the page. Bind widgets with the helpers in `app.ui`
  (``slider``, ``int_slider``, ``toggle``, ``select``: first argument the page); they are two-way.
- **Compute** with ``services.shared(("pdf", keys, noise, n_bin), compute)``: one computation for all
  sessions; the key is everything the result depends on. ``session.ensembles`` are the chosen
  `Choice` objects, M0 first; ``services.ensemble(choice.key)`` and ``services.geometry(model)`` give
  the arrays; ``services.observed(session.ensembles)`` are the chosen classes' streams as observed,
  with the noise that is theirs (`streamdash.survey.observed.ObservedStreams`).
- **Figures** are declared once by a function in ``streamdash/plots/`` (bodies read ``# Collect``,
  ``# Compute``, ``# Plot``; no Panel there), with labelled elements and fixed ranges. `LiveFigure`
  finds the Bokeh data source of each label; ``patch`` writes new arrays. Long arrays, few of them,
  never ragged lists, never new figures. Class colours: ``streamdash.naming.class_colours(configs)``.
  Ink that must contrast with the page (medians, reference lines): put the label in
  ``LiveFigure(..., ink=("median", ...))`` and call ``live.set_ink(session.dark)`` when "theme" changes.
- **Errors**: raise `app.services.services.Unavailable` with one sentence for what cannot be shown;
  ``ui.error_state`` and ``ui.message`` draw the rest.
- **HTML** is a Jinja template beside the page (``pages/<key>/name.html``; macros in ``ui/macros.html``),
  filled by ``ui.render`` and shown by ``ui.Html``, which shows anything else as text, whoever wrote it.
- **Downloads and code**: `FigureCard` makes PNG, SVG, PDF, CSV and the code, behind "Export",
  of what is shown *now*: pass functions, not values. `say` sets the sentence under the figure
  (screen readers hear it).
- Give what a browser test holds on to a CSS class ``sd-…``.
"""
