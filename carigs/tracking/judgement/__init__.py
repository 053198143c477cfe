"""How well a head was tracked, and what to record otherwise.

- `judged_frames.JudgedFrames`: values of all frames, and the contact sheet
- `error_table.error_table`: errors by region
- `advice.advice`: sentences with numbers
"""
