"""Networks that judge images: their weights, how images are prepared for them, and what they give."""
