"""When Python looks for cyclic garbage: not while the window is made, and not through what stays for good.

The packages that a window needs are some 600,000 objects; walking through them all takes 0.2 s, several times
while it starts and again in the middle of an animation.
"""

from __future__ import annotations

import gc


def pause_collection() -> None:
    """Look for no garbage until `resume_collection`: nearly all that a start makes stays."""
    gc.disable()


def resume_collection() -> None:
    """Look for garbage again, but never more among what was made so far."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
