"""Force elements that SDF has no word for: struts, rubber with friction, tyres; parameters and equations together."""
