"""Libraries that would look for weights over the network."""

from __future__ import annotations

import os


def work_offline() -> None:
    """Tell the client of the Hugging Face hub to ask nothing over the network, which it otherwise waits for.

    It reads this when it is imported: call this before a network library is. Weights are found or downloaded by
    `carigs.weights`, never by those libraries.
    """
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
