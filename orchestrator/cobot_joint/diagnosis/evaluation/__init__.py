"""How often the diagnosis is right: concealed campaigns, synthetic faults, baselines, scores."""
