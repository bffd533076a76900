"""Figures: HoloViews elements, one file a figure. The only library code that imports HoloViews."""
