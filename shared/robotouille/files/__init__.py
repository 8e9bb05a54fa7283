"""Files of people: bounded reading, writing of whole files, files that only their owner reads."""
