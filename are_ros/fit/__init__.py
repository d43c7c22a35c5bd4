"""`are fit`: observed rows in, the Poisson mixture that explains them out."""
