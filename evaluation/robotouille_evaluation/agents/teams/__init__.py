"""Teams: how the models of several seats are asked, and what they say to each other."""
