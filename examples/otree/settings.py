"""Settings of the oTree project. Only the session configuration belongs to the example."""

from os import environ

SESSION_CONFIGS = [
    {
        "name": "cooking",
        "display_name": "Cook with a partner",
        "app_sequence": ["cooking"],
        "num_demo_participants": 2,
    }
]
SESSION_CONFIG_DEFAULTS = {"real_world_currency_per_point": 1.0, "participation_fee": 0.0}
PARTICIPANT_FIELDS: list[str] = []
SESSION_FIELDS: list[str] = []
LANGUAGE_CODE = "en"
REAL_WORLD_CURRENCY_CODE = "EUR"
USE_POINTS = False
ADMIN_USERNAME = "admin"
ADMIN_PASSWORD = environ.get("OTREE_ADMIN_PASSWORD")
SECRET_KEY = environ.get("OTREE_SECRET_KEY", "only-for-a-demonstration")
