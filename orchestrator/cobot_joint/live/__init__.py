"""`cobot-joint open`: results, or the bench itself, as a page in the browser that simulates while sliders move."""
