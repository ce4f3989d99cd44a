# SPDX-License-Identifier: Apache-2.0
"""Networks of torchvision, timm and transformers, each built in one of four forms.

  eager     Python calls every operator
  traced    torch.jit.trace and freeze: one call from Python
  compiled  torch.compile in its default mode: fused kernels, launched from Python
  graph     a CUDA graph of the eager network, replayed

Weights and inputs are random and seeded: what a network takes does not depend on them. Half
precision, channels last where there are convolutions, no algorithm chosen by timing. The list can be
read without PyTorch, which only building needs.
"""
import hashlib
import typing

FORMS = ("eager", "traced", "compiled", "graph")
TOKENS = 128
TINY_TOKENS = 8
VOCABULARY = 1000
CAPTURE_WARM_UP = 3
MOST_COMPILED = 64


class Kind(typing.NamedTuple):
    library: str
    make: str          # the library's name of it
    batch: int = 8
    pixels: int = 224  # 0: takes tokens, not pictures
    tiny_pixels: int = 64
    options: tuple = ()


def _vision(make, **other):
    return Kind("torchvision", make, **other)


# tiny_pixels: the least that the network accepts; those that know positions accept one size.
KINDS = {
    "resnet18": _vision("resnet18"),
    "resnet50": _vision("resnet50"),
    "wide_resnet50": _vision("wide_resnet50_2"),
    "resnext50": _vision("resnext50_32x4d"),
    "regnet_y_8gf": _vision("regnet_y_8gf", pixels=320),
    "regnet_x_3gf": _vision("regnet_x_3_2gf"),
    "mobilenet_v2": _vision("mobilenet_v2"),
    "mobilenet_v3": _vision("mobilenet_v3_large"),
    "densenet121": _vision("densenet121"),
    "effnet_b0": _vision("efficientnet_b0"),
    "effnet_b2": _vision("efficientnet_b2", pixels=288),
    "convnext_tiny": _vision("convnext_tiny"),
    "vit_b_16": _vision("vit_b_16", tiny_pixels=224),
    "swin_t": _vision("swin_t", tiny_pixels=224),
    "squeezenet": _vision("squeezenet1_1"),
    "shufflenet": _vision("shufflenet_v2_x1_0"),
    "googlenet": _vision("googlenet", options=(("aux_logits", False), ("init_weights", False))),
    "inception": _vision("inception_v3", pixels=299, tiny_pixels=96,
                         options=(("aux_logits", False), ("init_weights", False))),
    "mnasnet": _vision("mnasnet1_0"),
    "vgg16": _vision("vgg16", batch=4),
    "deeplabv3": _vision("segmentation.deeplabv3_resnet50", batch=2, pixels=320,
                         options=(("weights_backbone", None),)),
    "fcn": _vision("segmentation.fcn_resnet50", batch=2, pixels=320,
                   options=(("weights_backbone", None),)),
    "lraspp": _vision("segmentation.lraspp_mobilenet_v3_large", pixels=320,
                      options=(("weights_backbone", None),)),
    "hrnet_w18": Kind("timm", "hrnet_w18"),
    "ghostnet": Kind("timm", "ghostnet_100"),
    "mixer": Kind("timm", "mixer_s16_224", tiny_pixels=224),
    "deit_tiny": Kind("timm", "deit_tiny_patch16_224", tiny_pixels=224),
    "dla34": Kind("timm", "dla34"),
    "bert_small": Kind("transformers", "Bert", pixels=0),
    "distilbert": Kind("transformers", "DistilBert", pixels=0),
    "segformer": Kind("transformers", "Segformer", batch=2, pixels=320),
}


def known(name, form):
    """@returns what is wrong with a network's name and form; empty if nothing is"""
    if name not in KINDS:
        return f"network: found {name}, accepted: {', '.join(KINDS)}"
    if form not in FORMS:
        return f"{name}: form: found {form}, accepted: {', '.join(FORMS)}"
    return ""


def transformer(make):
    import transformers as t

    if make == "Bert":
        return t.BertModel(t.BertConfig(vocab_size=VOCABULARY, hidden_size=512, num_hidden_layers=4,
                                        num_attention_heads=8, intermediate_size=2048))
    if make == "DistilBert":
        return t.DistilBertModel(t.DistilBertConfig(vocab_size=VOCABULARY))
    return t.SegformerForSemanticSegmentation(t.SegformerConfig(num_labels=19))


def make_module(kind):
    if kind.library == "transformers":
        return transformer(kind.make)
    if kind.library == "timm":
        import timm

        return timm.create_model(kind.make, pretrained=False, **dict(kind.options))
    from torchvision import models

    place = models
    for part in kind.make.split("."):
        place = getattr(place, part)
    return place(weights=None, **dict(kind.options))


def first_tensor(output, torch):
    """What the network answers, whatever it wraps it in: a trace returns tensors only."""
    if isinstance(output, torch.Tensor):
        return output
    if isinstance(output, (tuple, list)):
        return output[0]
    for key in ("out", "logits", "last_hidden_state"):
        if key in output:
            return output[key]
    return next(iter(output.values()))


def build(name, batch, tiny):
    """@param tiny  the smallest input that it accepts, one at a time
    @returns the module on the GPU, its input there, and the same input in pinned memory"""
    import torch

    kind = KINDS[name]
    torch.manual_seed(7)
    with torch.device("cuda"):  # initialising there takes milliseconds, on the CPU seconds
        inner = make_module(kind)
    inner = inner.eval().half()
    for parameter in inner.parameters():
        parameter.requires_grad_(False)

    class Module(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.inner = inner

        def forward(self, x):
            return first_tensor(self.inner(x), torch)

    module = Module().eval().cuda()
    size = 1 if tiny else batch or kind.batch
    if kind.pixels == 0:
        host = torch.randint(0, VOCABULARY, (size, TINY_TOKENS if tiny else TOKENS))
    else:
        module = module.to(memory_format=torch.channels_last)
        pixels = kind.tiny_pixels if tiny else kind.pixels
        host = torch.rand(size, 3, pixels, pixels).half().to(memory_format=torch.channels_last)
    return module, host.cuda(), host.pin_memory()


def in_form(form, module, x):
    """@returns a function of x that infers; a graph always infers what x holds"""
    import torch

    if form == "traced":
        return torch.jit.freeze(torch.jit.trace(module, x, check_trace=False, strict=False))
    if form == "compiled":
        import torch._dynamo

        # All networks are one class to it, and beyond so many it gives up compiling, silently.
        for name in ("recompile_limit", "cache_size_limit"):
            if hasattr(torch._dynamo.config, name):
                setattr(torch._dynamo.config, name, MOST_COMPILED)
        compiled = torch.compile(module, dynamic=False)
        compiled(x)
        return compiled
    if form == "graph":
        side = torch.cuda.Stream()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            for _ in range(CAPTURE_WARM_UP):
                module(x)
        torch.cuda.current_stream().wait_stream(side)
        torch.cuda.synchronize()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, capture_error_mode="thread_local"):
            answer = module(x)

        def replay(_, _weights=module):  # the graph reads them: they must outlive it
            graph.replay()
            return answer

        return replay
    return module


class TorchNetwork:
    """A network with its stream and its input. Made in one thread, used in another."""

    def __init__(self, spec, tiny=False):
        import torch

        self.torch = torch
        module, self.input, self.host = build(spec["network"], spec.get("batch", 0), tiny)
        with torch.inference_mode():
            self.infer = in_form(spec["form"], module, self.input)
        self.copies = spec.get("copy", False)
        self.stream = torch.cuda.Stream()
        self.answer = None
        torch.cuda.synchronize()

    def enter(self, stack):
        """What the calling thread needs, until the stack is closed."""
        stack.enter_context(self.torch.inference_mode())
        stack.enter_context(self.torch.cuda.stream(self.stream))

    def frame(self):
        if self.copies:
            self.input.copy_(self.host, non_blocking=True)
        self.answer = None  # before the next one: as if it were not kept
        self.answer = self.infer(self.input)
        self.stream.synchronize()

    def answer_sha256(self):
        """@returns of the last frame's bits; empty: there was none"""
        if self.answer is None:
            return ""
        bits = self.answer.contiguous().cpu().view(self.torch.uint8)
        return hashlib.sha256(bits.numpy().tobytes()).hexdigest()


def set_up_torch():
    """@returns what a result says about the software. No choice depends on timing."""
    import torch

    if not torch.cuda.is_available():
        return None
    torch.set_num_threads(1)
    torch.backends.cudnn.benchmark = False
    # The fuser of traces compiles for minutes, at each start, and is no longer developed.
    off = getattr(torch._C, "_jit_set_texpr_fuser_enabled", None)
    if off:
        off(False)
    return {"gpu": torch.cuda.get_device_name(), "torch": torch.__version__,
            "cudnn": torch.backends.cudnn.version()}
