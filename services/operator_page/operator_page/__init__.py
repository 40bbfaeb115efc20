"""Page in a browser from which an operator sets up, watches, decides, stops and reports."""
