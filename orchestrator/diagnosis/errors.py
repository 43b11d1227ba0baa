"""What a person did wrong with a campaign, in one line."""


class CampaignError(ValueError):
    """A campaign, or a file it names, is wrong: what was given, what is allowed, where. The command line exits with 2."""
