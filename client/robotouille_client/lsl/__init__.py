"""Streaming of episodes to the Lab Streaming Layer. Needs the extra `lsl`."""
