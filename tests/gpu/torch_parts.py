# SPDX-License-Identifier: Apache-2.0
"""What the PyTorch programs share: pinned kernels, models, graphs."""

# Set for every run: cuBLAS' workspace is part of what decides the order of its sums, and nothing is
# chosen by timing.
ENVIRONMENT = {"CUBLAS_WORKSPACE_CONFIG": ":4096:8", "TORCHINDUCTOR_MAX_AUTOTUNE": "0",
               "TORCHINDUCTOR_COORDINATE_DESCENT_TUNING": "0",
               "TORCHINDUCTOR_SHAPE_PADDING": "0", "TORCHINDUCTOR_DETERMINISTIC": "1"}


def pinned_torch(warn_only=False):
    """@returns the module, told to choose every kernel by rule"""
    import torch

    torch.backends.cudnn.benchmark = False
    torch.backends.cudnn.deterministic = True
    torch.backends.cudnn.allow_tf32 = False
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.use_deterministic_algorithms(True, warn_only=warn_only)
    torch.manual_seed(7)
    return torch


def collect(outputs, tensor):
    outputs.append(tensor.detach().float().cpu().numpy().tobytes())


def resnet50():
    import torchvision

    return torchvision.models.resnet50(weights=None).eval().cuda()


def encoder(torch, dropout=0.0):
    """Half of BERT, layer by layer as others write it: without this class' fused inference."""
    torch.backends.mha.set_fastpath_enabled(False)
    layer = torch.nn.TransformerEncoderLayer(d_model=512, nhead=8, dim_feedforward=2048,
                                             dropout=dropout, batch_first=True, norm_first=True)
    model = torch.nn.TransformerEncoder(layer, num_layers=6, enable_nested_tensor=False)
    return model.eval().cuda()


def captured(torch, model, example):
    """@returns a function that does what the model does, by replaying a graph of it"""
    static = example.clone()
    side = torch.cuda.Stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):
        for _ in range(3):
            model(static)
    torch.cuda.current_stream().wait_stream(side)
    graph = torch.cuda.CUDAGraph()
    # thread_local: in the default mode another thread's synchronisation would break the capture.
    with torch.cuda.graph(graph, capture_error_mode="thread_local"):
        result = model(static)

    def replay(inputs):
        static.copy_(inputs)
        graph.replay()
        return result.clone()

    return replay


def infer_every_way(torch, outputs, model, inputs):
    """Eager and as a CUDA graph, fp32 and fp16."""
    with torch.inference_mode():
        for half in (False, True):
            if half:
                model, inputs = model.half(), inputs.half()
            infer(torch, outputs, model, inputs, 10)
            infer(torch, outputs, captured(torch, model, inputs), inputs, 10)


def infer(torch, outputs, model, inputs, times):
    """Collects what the model says to as many different inputs; the host waits once, at the end."""
    results = []
    for i in range(times):
        results.append(model(inputs * (1 - i / times)))
    collect(outputs, torch.stack(results))
