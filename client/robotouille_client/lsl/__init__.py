"""`robotouille-lsl`: an episode's steps and actions in the Lab Streaming Layer. Needs `lsl`."""
