"""How results look: tables as text, and tables and pictures as HTML for a notebook. Nothing in it needs a network."""
