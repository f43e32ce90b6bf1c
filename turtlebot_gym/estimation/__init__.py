"""The extended Kalman filter and its variants, and statistics of a filter's consistency."""
