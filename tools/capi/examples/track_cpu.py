"""track-cpu from Python by ctypes, in place of cv2.TrackerNano. Needs only the shared library.

    import track_cpu
    tracker = track_cpu.Tracker()              # or Tracker(model="weights.safetensors", threads=2)
    tracker.init(frame, (300, 120, 40, 24))    # frame: a NumPy array as of cv2, H x W x 3, BGR
    ok, (x, y, w, h) = tracker.update(frame)   # not rounded
    score = tracker.getTrackingScore()

Flight mode says how sure it is and finds a lost target again:

    tracker = track_cpu.FlightTracker(coast=2.0)     # thresholds by name, see track_cpu.h
    tracker.init(frame, box)
    track = tracker.update(frame, elapsed=1 / 30)    # track.box, .presence, .state, .believed
    others = tracker.candidates()                    # [(box, score, similarity), ...]

A frame may also be a PIL image, or (bytes, width, height) of BGR pixels. The library is looked for
where the variable TRACK_CPU_LIBRARY says, beside this file, and in target/release;
`cargo build --release -p capi` makes it.

Run as a program it follows an object through headerless RGB frames:

    ffmpeg -i flight.mp4 -f rawvideo -pix_fmt rgb24 - | python3 track_cpu.py 1280 720 300 120 40 24
"""

import collections
import ctypes
import os
import pathlib
import sys

BGR, RGB, BGRA, RGBA, GRAY = range(5)
_CHANNELS = {BGR: 3, RGB: 3, BGRA: 4, RGBA: 4, GRAY: 1}
_MAX_SIDE = 32768


class Error(Exception):
    """What the library says went wrong; `code` is the number of track_cpu.h."""

    def __init__(self, code, words):
        super().__init__(words)
        self.code = code


class _Image(ctypes.Structure):
    _fields_ = [
        ("data", ctypes.c_void_p),
        ("width", ctypes.c_uint32),
        ("height", ctypes.c_uint32),
        ("stride", ctypes.c_size_t),
        ("format", ctypes.c_uint32),
    ]


class _Box(ctypes.Structure):
    _fields_ = [(name, ctypes.c_float) for name in "xywh"]


class _FlightOptions(ctypes.Structure):
    _fields_ = [
        ("present", ctypes.c_double),
        ("sure", ctypes.c_double),
        ("absent", ctypes.c_double),
        ("patience", ctypes.c_double),
        ("coast", ctypes.c_double),
        ("fps", ctypes.c_double),
        ("confirm", ctypes.c_uint32),
        ("tell_only", ctypes.c_uint32),
    ]


class _FlightTrack(ctypes.Structure):
    _fields_ = [
        ("box", _Box),
        ("score", ctypes.c_float),
        ("presence", ctypes.c_float),
        ("state", ctypes.c_uint32),
        ("believed", ctypes.c_uint32),
        ("searches", ctypes.c_uint32),
    ]


class _Candidate(ctypes.Structure):
    _fields_ = [("box", _Box), ("score", ctypes.c_float), ("similarity", ctypes.c_float)]


STATES = ("tracking", "low_confidence", "coasting", "lost", "reacquired")
FlightTrack = collections.namedtuple("FlightTrack", "box score presence state believed searches")


def _load():
    here = pathlib.Path(__file__).resolve().parent
    names = {"darwin": "libtrack_cpu_c.dylib", "win32": "track_cpu_c.dll"}
    name = names.get(sys.platform, "libtrack_cpu_c.so")
    named = os.environ.get("TRACK_CPU_LIBRARY")
    built = here.parents[2] / "target" / "release" / name
    places = [pathlib.Path(named)] if named else [here / name, built]
    for place in places:
        if place.exists():
            break
    else:
        looked = " or ".join(map(str, places))
        raise OSError(f"no {looked}; `cargo build --release -p capi` makes it")
    library = ctypes.CDLL(str(place))
    handle, image, box = ctypes.c_void_p, ctypes.POINTER(_Image), ctypes.POINTER(_Box)
    for function, arguments in [
        ("create", [ctypes.c_char_p, ctypes.c_uint32, ctypes.POINTER(handle)]),
        ("init", [handle, image, box]),
        ("update", [handle, image, box]),
        ("score", [handle, ctypes.POINTER(ctypes.c_float)]),
        ("flight_defaults", [ctypes.POINTER(_FlightOptions)]),
        (
            "create_flight",
            [
                ctypes.c_char_p,
                ctypes.c_uint32,
                ctypes.POINTER(_FlightOptions),
                ctypes.POINTER(handle),
            ],
        ),
        (
            "update_flight",
            [handle, image, ctypes.c_double, ctypes.c_double, ctypes.POINTER(_FlightTrack)],
        ),
        (
            "candidates",
            [handle, ctypes.POINTER(_Candidate), ctypes.c_uint32, ctypes.POINTER(ctypes.c_uint32)],
        ),
    ]:
        getattr(library, "track_cpu_" + function).argtypes = arguments
    library.track_cpu_destroy.argtypes = [handle]
    library.track_cpu_destroy.restype = None
    library.track_cpu_last_error.restype = ctypes.c_char_p
    library.track_cpu_version.restype = ctypes.c_char_p
    return library


_library = _load()
__version__ = _library.track_cpu_version().decode()


def _check(code):
    if code:
        raise Error(code, _library.track_cpu_last_error().decode())


def _image(frame, format):
    """The picture as the library takes it, and the object to keep alive while it is used."""
    if frame is None:
        reason = "cv2 gives None at the end of a video and for a missing file"
        raise ValueError(f"frame is None, expected a picture: {reason}")
    if isinstance(frame, tuple):
        data, width, height = frame
        pixel = _CHANNELS[format]
        if len(data) < width * height * pixel:
            expected = f"{width * height * pixel}: {width} x {height} x {pixel}"
            raise ValueError(f"{len(data)} bytes, expected {expected}")
        kept = ctypes.c_char_p(bytes(data))
        return _Image(ctypes.cast(kept, ctypes.c_void_p), width, height, 0, format), kept
    array = getattr(frame, "__array_interface__", None)
    if array is None:
        kind = type(frame).__name__
        expected = "an H x W x C array of uint8 or (bytes, width, height)"
        raise ValueError(f"frame is a {kind}, expected {expected}")
    shape = array["shape"]
    strides = array.get("strides")
    if array["typestr"] != "|u1" or len(shape) not in (2, 3):
        found = f"an array of {array['typestr']} with shape {shape}"
        raise ValueError(f"{found}, expected uint8 with H x W x C")
    channels = shape[2] if len(shape) == 3 else 1
    if len(shape) == 2 or channels == 1:
        format = GRAY
    elif channels == 4 and format in (BGR, RGB):
        format = BGRA if format == BGR else RGBA
    if channels != _CHANNELS[format]:
        raise ValueError(f"{channels} channels, expected 1, 3 or 4")
    if isinstance(array.get("data"), bytes):  # a PIL image: packed rows, in RGB order
        if format in (BGR, BGRA):
            format = RGB if format == BGR else RGBA
        return _image((array["data"], shape[1], shape[0]), format)
    if max(shape[:2]) > _MAX_SIDE:  # before it is copied
        raise ValueError(f"{shape[1]} x {shape[0]} pixels, expected at most {_MAX_SIDE} a side")
    row = shape[1] * channels
    packed = (channels, 1)[: len(shape) - 1]
    if strides is not None and (strides[1:] != packed or strides[0] < row):
        frame = frame.copy()
        array = frame.__array_interface__
        strides = array.get("strides")
    stride = strides[0] if strides is not None else 0
    return _Image(array["data"][0], shape[1], shape[0], stride, format), frame


def _box(box):
    try:
        x, y, w, h = map(float, box)
    except (TypeError, ValueError):
        expected = "four numbers: left, top, width, height in pixels"
        raise ValueError(f"box is {box!r}, expected {expected}") from None
    return _Box(x, y, w, h)


def _threads(threads):
    if not isinstance(threads, int) or not 0 <= threads < 2**32:
        raise ValueError(f"threads is {threads!r}, expected a number from 1 to 256")
    return threads


class Tracker:
    """Follows one object. Calls from several threads wait for each other.

    After os.fork a tracker of several threads raises Error in the child: make a new one there.
    A tracker cannot be copied or pickled.
    """

    def __init__(self, model=None, threads=1):
        self._handle = ctypes.c_void_p()
        path = None if model is None else os.fsencode(model)
        _check(_library.track_cpu_create(path, _threads(threads), ctypes.byref(self._handle)))

    def __del__(self):
        if getattr(self, "_handle", None):
            _library.track_cpu_destroy(self._handle)
            self._handle = None

    def __reduce__(self):
        raise TypeError("a Tracker cannot be copied or pickled: make a new one and init it")

    def init(self, frame, box, format=BGR):
        """Takes what is inside the box (x, y, w, h) as the target."""
        image, kept = _image(frame, format)
        target = _box(box)
        _check(_library.track_cpu_init(self._handle, ctypes.byref(image), ctypes.byref(target)))
        del kept

    def update(self, frame, format=BGR):
        """Finds the target: True and its box; getTrackingScore() says how sure that is."""
        image, kept = _image(frame, format)
        box = _Box()
        _check(_library.track_cpu_update(self._handle, ctypes.byref(image), ctypes.byref(box)))
        del kept
        return True, (box.x, box.y, box.w, box.h)

    def getTrackingScore(self):
        """How sure the tracker is of the last box, from 0 to 1."""
        score = ctypes.c_float()
        _check(_library.track_cpu_score(self._handle, ctypes.byref(score)))
        return score.value


class FlightTracker(Tracker):
    """Follows one object and says whether it is there.

    Thresholds are those of track_cpu.h, by name.
    """

    def __init__(self, model=None, threads=1, **thresholds):
        self._handle = ctypes.c_void_p()
        options = _FlightOptions()
        _check(_library.track_cpu_flight_defaults(ctypes.byref(options)))
        for name, value in thresholds.items():
            if not hasattr(options, name):
                known = ", ".join(name for name, _ in _FlightOptions._fields_)
                raise TypeError(f"no threshold {name!r}, expected one of {known}")
            setattr(options, name, value)
        path = None if model is None else os.fsencode(model)
        _check(
            _library.track_cpu_create_flight(
                path, _threads(threads), ctypes.byref(options), ctypes.byref(self._handle)
            )
        )

    def update(self, frame, format=BGR, elapsed=0.0, deadline=0.0):
        """Finds the target, `elapsed` seconds after the last frame (0: 1 / fps): a FlightTrack.

        Searches for a lost one take at most `deadline` seconds; 0 for two searches.
        """
        image, kept = _image(frame, format)
        found = _FlightTrack()
        _check(
            _library.track_cpu_update_flight(
                self._handle, ctypes.byref(image), elapsed, deadline, ctypes.byref(found)
            )
        )
        del kept
        box = (found.box.x, found.box.y, found.box.w, found.box.h)
        state = STATES[found.state]
        believed = bool(found.believed)
        return FlightTrack(box, found.score, found.presence, state, believed, found.searches)

    def candidates(self):
        """The places that the last search found, the chosen one first: box, score, similarity."""
        places = (_Candidate * 8)()
        count = ctypes.c_uint32()
        found = _library.track_cpu_candidates(
            self._handle, places, len(places), ctypes.byref(count)
        )
        _check(found)
        return [
            ((place.box.x, place.box.y, place.box.w, place.box.h), place.score, place.similarity)
            for place in places[: count.value]
        ]


def main():
    if len(sys.argv) != 7:
        sys.exit("usage: track_cpu.py WIDTH HEIGHT X Y W H < frames.rgb")
    width, height = map(int, sys.argv[1:3])
    box = tuple(map(float, sys.argv[3:]))
    tracker = None
    while len(pixels := sys.stdin.buffer.read(width * height * 3)) == width * height * 3:
        if tracker is None:
            tracker = Tracker()
            tracker.init((pixels, width, height), box, RGB)
        else:
            _, box = tracker.update((pixels, width, height), RGB)
        print(",".join(f"{v:.3f}" for v in box) + f",{tracker.getTrackingScore():.4f}")


if __name__ == "__main__":
    main()
