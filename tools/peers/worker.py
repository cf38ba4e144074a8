"""One engine in a process of its own: `worker.py ENGINE WIDTHS THREADS FOLDER`.

Makes the engine's model in FOLDER unless it exists, warms up, and prints READY and the engine's
version. Then it runs N passes for each line N of standard input, and prints their times in
milliseconds. `track-cpu bench worker` speaks the same protocol.
"""

import pathlib
import subprocess
import sys
import time

import network
import onnx

engine, widths, threads, folder = (
    sys.argv[1],
    sys.argv[2],
    int(sys.argv[3]),
    pathlib.Path(sys.argv[4]),
)
x = network.crop(1)
source = folder / f"{widths}.onnx"
if not source.exists():
    onnx.save(network.search_pass(widths)[0], source)


def onnx_runtime(int8):
    import onnxruntime as ort

    path = source
    if int8:
        from onnxruntime.quantization import (
            CalibrationDataReader,
            QuantFormat,
            QuantType,
            quantize_static,
        )

        class Crops(CalibrationDataReader):
            def __init__(self):
                self.crops = iter([{"x": network.crop(i)} for i in range(4)])

            def get_next(self):
                return next(self.crops, None)

        path = folder / f"{widths}.ort-int8.onnx"
        if not path.exists():
            kinds = {"activation_type": QuantType.QUInt8, "weight_type": QuantType.QInt8}
            layers = ["Conv", "MaxPool", "Relu"]
            quantize_static(
                source,
                path,
                Crops(),
                QuantFormat.QDQ,
                per_channel=True,
                op_types_to_quantize=layers,
                **kinds,
            )
    options = ort.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 3
    session = ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    return f"onnxruntime {ort.__version__}", lambda: session.run(None, {"x": x})


def openvino(int8):
    import openvino as ov

    core, path = ov.Core(), source
    if int8:
        path = folder / f"{widths}.openvino-int8.xml"
        if not path.exists():
            import nncf

            crops = nncf.Dataset([network.crop(i) for i in range(4)])
            quantized = nncf.quantize(
                core.read_model(source), crops, preset=nncf.QuantizationPreset.PERFORMANCE
            )
            ov.save_model(quantized, path, compress_to_fp16=False)
    config = {
        "INFERENCE_NUM_THREADS": threads,
        "NUM_STREAMS": 1,
        "PERFORMANCE_HINT": "LATENCY",
        "ENABLE_CPU_PINNING": False,
    }
    if not int8:
        config["INFERENCE_PRECISION_HINT"] = "f32"
    request = core.compile_model(core.read_model(path), "CPU", config).create_infer_request()
    version = ov.get_version().split("-")[0]
    return f"OpenVINO {version}", lambda: request.infer(
        {"x": x}, share_inputs=True, share_outputs=True
    )


def mnn():
    import importlib.metadata

    import MNN

    path = folder / f"{widths}.mnn"
    if not path.exists():
        # Runs the converter's compiled part: its Python wrapper would install a telemetry package.
        arguments = [
            "mnnconvert",
            "-f",
            "ONNX",
            "--modelFile",
            str(source),
            "--MNNModel",
            str(path),
            "--bizCode",
            "x",
        ]
        command = [sys.executable, "-c", f"import _tools; _tools.mnnconvert({arguments!r})"]
        subprocess.run(command, check=True, capture_output=True, env={"PATH": "/nonexistent"})
    config = {"backend": "CPU", "numThread": threads, "precision": "high", "memory": "normal"}
    runtime = MNN.nn.create_runtime_manager((config,))
    net = MNN.nn.load_module_from_file(
        str(path), ["x"], ["scores", "ltrb"], runtime_manager=runtime
    )
    given = MNN.expr.placeholder(list(x.shape), MNN.expr.NCHW)
    given.write(x)
    given = MNN.expr.convert(given, MNN.expr.NC4HW4)
    return f"MNN {importlib.metadata.version('MNN')}", lambda: [
        out.read() for out in net.forward([given])
    ]


make = {
    "ort": lambda: onnx_runtime(False),
    "ort-int8": lambda: onnx_runtime(True),
    "openvino": lambda: openvino(False),
    "openvino-int8": lambda: openvino(True),
    "mnn": mnn,
}
version, run = make[engine]()
for _ in range(8):
    run()
print(f"READY {version}", flush=True)
for line in sys.stdin:
    times = []
    for _ in range(int(line)):
        start = time.perf_counter()
        run()
        times.append((time.perf_counter() - start) * 1e3)
    print(" ".join(f"{ms:.4f}" for ms in times), flush=True)
