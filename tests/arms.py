"""The arms that most tests try: those of the papers."""

FIVE = ("abaas", "humanoid", "mico", "scorbot", "uzuner")
