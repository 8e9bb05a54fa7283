"""What has happened in an episode so far, by steps."""
