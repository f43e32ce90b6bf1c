"""Drives in a browser, drawn by Bokeh: a satellite, of the extra [view], which the product never imports."""
