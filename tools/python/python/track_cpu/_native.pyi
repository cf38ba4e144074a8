"""Types of the native module; its docstrings describe shapes, units and errors."""

import os
from typing import Any, Final, Iterable, List, Literal, NoReturn, Optional, SupportsFloat
from typing import Tuple, Union, final

import numpy as np
import numpy.typing as npt

from ._results import Box, Candidate, FlightTrack, Track

__version__: Final[str]
BELIEVED: Final[float]
builtin_models: Final[Tuple[str, ...]]

_Path = Union[str, "os.PathLike[str]"]
_Precision = Literal["f32", "int8"]
_Order = Literal["bgr", "rgb", "nv12", "nv21", "i420", "yuyv", "uyvy"]
_State = Literal["tracking", "low_confidence", "coasting", "lost", "reacquired"]
# A NumPy array of uint8, or whatever NumPy makes one of: a PIL image, a PyTorch tensor on the CPU.
_Image = Union[npt.NDArray[np.uint8], Any]
_Box = Iterable[SupportsFloat]

class ModelError(ValueError): ...

@final
class Model:
    def __new__(
        cls, name: _Path = "drmim-p50", *, precision: Optional[_Precision] = None
    ) -> Model: ...
    @property
    def name(self) -> str: ...
    @property
    def precision(self) -> _Precision: ...
    @property
    def isa(self) -> str: ...
    def __reduce__(self) -> NoReturn: ...

class Tracker:
    def __new__(
        cls,
        model: Union[_Path, Model] = "drmim-p50",
        *,
        precision: Optional[_Precision] = None,
        threads: int = 1,
        as_published: bool = False,
        order: _Order = "bgr",
    ) -> Tracker: ...
    def init(self, image: _Image, box: _Box) -> None: ...
    def update(self, image: _Image) -> Tuple[bool, Box]: ...
    def __call__(self, image: _Image) -> Track: ...
    @property
    def score(self) -> float: ...
    def getTrackingScore(self) -> float: ...
    @property
    def model(self) -> Model: ...
    @property
    def threads(self) -> int: ...
    @property
    def order(self) -> _Order: ...
    def __reduce__(self) -> NoReturn: ...

class FlightTracker:
    def __new__(
        cls,
        model: Union[_Path, Model] = "drmim-p50",
        *,
        precision: Optional[_Precision] = None,
        threads: int = 1,
        as_published: bool = False,
        order: _Order = "bgr",
        fps: Optional[float] = None,
        present: Optional[float] = None,
        sure: Optional[float] = None,
        absent: Optional[float] = None,
        patience: Optional[float] = None,
        coast: Optional[float] = None,
        confirm: Optional[int] = None,
        recover: bool = True,
        searches: Optional[int] = None,
        deadline: Optional[float] = None,
    ) -> FlightTracker: ...
    def init(self, image: _Image, box: _Box) -> None: ...
    def update(self, image: _Image, elapsed: Optional[float] = None) -> Tuple[bool, Box]: ...
    def __call__(self, image: _Image, elapsed: Optional[float] = None) -> FlightTrack: ...
    def stop(self) -> None: ...
    @property
    def track(self) -> Optional[FlightTrack]: ...
    @property
    def ok(self) -> bool: ...
    @property
    def state(self) -> Optional[_State]: ...
    @property
    def presence(self) -> float: ...
    @property
    def score(self) -> float: ...
    def getTrackingScore(self) -> float: ...
    @property
    def candidates(self) -> List[Candidate]: ...
    @property
    def model(self) -> Model: ...
    @property
    def threads(self) -> int: ...
    @property
    def order(self) -> _Order: ...
    def __reduce__(self) -> NoReturn: ...

@final
class Flight:
    def __new__(
        cls,
        frames: int = 300,
        *,
        seed: int = 7,
        difficulty: Literal["easy", "medium", "hard"] = "easy",
        width: int = 640,
        height: int = 360,
    ) -> Flight: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Tuple[npt.NDArray[np.uint8], Box, float]: ...
