"""Results as named tuples; the native module makes them."""

from typing import NamedTuple, Tuple

Box = Tuple[float, float, float, float]


class Track(NamedTuple):
    """Where the target is in one picture."""

    ok: bool  # always True
    box: Box  # left, top, width, height in pixels
    score: float  # how well the box fits, 0 to 1; no probability


class FlightTrack(NamedTuple):
    """Where the target is in one picture, and whether it is there."""

    ok: bool  # the box is worth acting on
    box: Box  # left, top, width, height in pixels; predicted while coasting or lost
    score: float  # how well the box fits, 0 to 1; no probability
    presence: float  # probability that the box is on the target, 0 to 1
    state: str  # tracking, low_confidence, coasting, lost or reacquired
    searches: int  # made for this picture


class Candidate(NamedTuple):
    """One place where the target may be."""

    box: Box  # left, top, width, height in pixels
    score: float  # 0 to 1
    similarity: float  # cosine of its features with the target's, -1 to 1
