"""Recordings of robots: read them, calibrate noise from them, localize them in maps; filters compared.

A satellite: it builds on the product, which finds its commands by entry points and never imports it.
"""
