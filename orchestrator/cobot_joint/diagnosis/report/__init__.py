"""The answer in words and pictures: the only room that makes prose."""
