"""One engine in a process of its own: `worker.py ENGINE NETWORK THREADS FOLDER`.

Makes the engine's model in FOLDER unless it exists, warms up, and prints READY and the engine's
version. Then it runs N passes for each line N of standard input, and prints their times in
milliseconds. `track-cpu bench worker` speaks the same protocol.
"""

import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

import network
import numpy as np
import onnx
import onnx.numpy_helper

engine, name, threads, folder = (
    sys.argv[1],
    sys.argv[2],
    int(sys.argv[3]),
    pathlib.Path(sys.argv[4]),
)
x = network.crop(1)
source = folder / f"{name}.onnx"
if not source.exists():
    onnx.save(network.search_pass(name)[0], source)


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

        path = folder / f"{name}.ort-int8.onnx"
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
        path = folder / f"{name}.openvino-int8.xml"
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
    shared = {"share_inputs": True, "share_outputs": True}
    return f"OpenVINO {version}", lambda: list(request.infer({"x": x}, **shared).values())


def mnn():
    import importlib.metadata

    import MNN

    path = folder / f"{name}.mnn"
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


def ncnn():
    import importlib.metadata

    import ncnn as engine
    import pnnx

    path = folder / f"{name}.ncnn"
    if not pathlib.Path(f"{path}.param").exists():
        with tempfile.TemporaryDirectory() as made:
            copy = shutil.copy(source, made)
            converter = pathlib.Path(pnnx.__file__).with_name("pnnx")
            command = [converter, copy, "fp16=0"]
            subprocess.run(command, cwd=made, check=True, capture_output=True)
            for end in (".bin", ".param"):
                # ".param", which the next run looks for, comes last
                shutil.move(pathlib.Path(made) / f"{source.stem}.ncnn{end}", f"{path}{end}")
    net = engine.Net()
    net.opt.num_threads = threads
    net.opt.use_vulkan_compute = False
    net.opt.use_fp16_packed = net.opt.use_fp16_storage = net.opt.use_fp16_arithmetic = False
    net.load_param(f"{path}.param")
    net.load_model(f"{path}.bin")
    given, outputs = engine.Mat(x[0]), net.output_names()

    def run():
        extractor = net.create_extractor()
        extractor.input(net.input_names()[0], given)
        return [np.array(extractor.extract(output)[1]) for output in outputs]

    return f"ncnn {importlib.metadata.version('ncnn')}", run


def tensorflow_function():
    """The graph as TensorFlow writes it, with channels last."""
    import tensorflow as tf

    graph = onnx.load(source).graph
    constants = {c.name: onnx.numpy_helper.to_array(c) for c in graph.initializer}
    functions = {"Relu": tf.nn.relu, "Sigmoid": tf.sigmoid, "Exp": tf.exp, "Mul": tf.multiply}

    @tf.function(input_signature=[tf.TensorSpec([1, network.SIDE, network.SIDE, 3], tf.float32)])
    def forward(value):
        values = {"x": value}
        for node in graph.node:
            inputs = [values[n] for n in node.input if n in values]
            options = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
            if node.op_type == "Conv":
                weights, *bias = [constants[n] for n in node.input if n in constants]
                padding = "SAME" if any(options.get("pads", [])) else "VALID"
                if options.get("group", 1) > 1:
                    weights = weights.transpose(2, 3, 0, 1)
                    made = tf.nn.depthwise_conv2d(inputs[0], weights, [1] * 4, padding)
                else:
                    weights = weights.transpose(2, 3, 1, 0)
                    made = tf.nn.conv2d(inputs[0], weights, options["strides"], padding)
                made = tf.nn.bias_add(made, bias[0]) if bias else made
            elif node.op_type == "MaxPool":
                padding = "SAME" if options["ceil_mode"] else "VALID"
                made = tf.nn.max_pool2d(inputs[0], 3, 2, padding)
            else:
                made = functions[node.op_type](*inputs)
            values[node.output[0]] = made
        return [values[output.name] for output in graph.output]

    return forward


def litert(int8):
    import importlib.metadata

    path = folder / f"{name}{'.int8' if int8 else ''}.tflite"
    if not path.exists():
        import tensorflow as tf

        function = tensorflow_function()
        converter = tf.lite.TFLiteConverter.from_concrete_functions(
            [function.get_concrete_function()], function
        )
        if int8:
            converter.optimizations = [tf.lite.Optimize.DEFAULT]
            converter.representative_dataset = lambda: (
                [network.crop(i).transpose(0, 2, 3, 1)] for i in range(4)
            )
        path.write_bytes(converter.convert())
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(str(path), num_threads=threads)
    interpreter.allocate_tensors()
    given = interpreter.get_input_details()[0]["index"]
    outputs = [output["index"] for output in interpreter.get_output_details()]
    crop = np.ascontiguousarray(x.transpose(0, 2, 3, 1))

    def run():
        interpreter.set_tensor(given, crop)
        interpreter.invoke()
        return [interpreter.get_tensor(output) for output in outputs]

    return f"LiteRT {importlib.metadata.version('ai-edge-litert')}", run


def torch():
    import torch as engine

    engine.set_num_threads(threads)
    graph = onnx.load(source).graph
    constants = {
        c.name: engine.from_numpy(onnx.numpy_helper.to_array(c).copy()) for c in graph.initializer
    }
    functions = {
        "Relu": engine.relu,
        "Sigmoid": engine.sigmoid,
        "Exp": engine.exp,
        "Mul": engine.mul,
    }

    class Forward(engine.nn.Module):
        def forward(self, value):
            values = {"x": value}
            for node in graph.node:
                inputs = [values[n] for n in node.input if n in values]
                options = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
                if node.op_type == "Conv":
                    given = [constants[n] for n in node.input if n in constants]
                    weights, bias = given if len(given) == 2 else (*given, None)
                    stride, pad = options.get("strides", [1])[0], options.get("pads", [0])[0]
                    made = engine.conv2d(
                        inputs[0], weights, bias, stride, pad, groups=options.get("group", 1)
                    )
                elif node.op_type == "MaxPool":
                    made = engine.max_pool2d(inputs[0], 3, 2, ceil_mode=bool(options["ceil_mode"]))
                else:
                    made = functions[node.op_type](*inputs)
                values[node.output[0]] = made
            return [values[output.name] for output in graph.output]

    given = engine.from_numpy(x)
    with engine.inference_mode():
        # The graph is traced, so that no Python runs between its nodes.
        traced = engine.jit.freeze(engine.jit.trace(Forward().eval(), given))

    def run():
        with engine.inference_mode():
            return [output.numpy() for output in traced(given)]

    return f"PyTorch {engine.__version__.split('+')[0]}", run


make = {
    "ort": lambda: onnx_runtime(False),
    "ort-int8": lambda: onnx_runtime(True),
    "openvino": lambda: openvino(False),
    "openvino-int8": lambda: openvino(True),
    "mnn": mnn,
    "ncnn": ncnn,
    "litert": lambda: litert(False),
    "litert-int8": lambda: litert(True),
    "torch": torch,
}
version, run = make[engine]()
if "--check" in sys.argv[5:]:  # the sums of the outputs, to hold one engine against another
    print(sorted(float(np.asarray(value, np.float64).sum()) for value in run()))
    raise SystemExit
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
