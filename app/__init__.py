"""What the browser shows. The only code that imports Panel; the science is in ``streamdash``."""
