"""From recordings of a bench to the parameters of units, each with its covariance."""
