"""The Evidence page on all shipped streams, where what it shows needs so many."""

from streamdash.plots import evidence


def test_by_default_every_bin_of_the_central_range_counts(open_shell):
    page = open_shell("?page=evidence&mass=1e3-1e5,1e5-1e9").page
    assert page.data.evidence.kept(0, 0, 1).all()
    assert len(page.live.sources[evidence.EXCLUDED].data["x0"]) == 0
