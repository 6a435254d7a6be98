"""Tables in text files, as exporters of many programs write them."""
