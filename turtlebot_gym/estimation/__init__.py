"""The extended Kalman filter, and the statistics that say whether a filter's stated uncertainty is true."""
