"""Hand motion: read from data sets or made up, fitted to a robot hand, sorted into what can be imitated and what cannot."""
