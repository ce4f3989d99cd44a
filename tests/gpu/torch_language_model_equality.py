#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Small causal language models (transformers, random weights) generate tokens, greedily."""
import equality
import torch_parts as parts

NEW_TOKENS = 32
VOCABULARY = 1000


def models():
    import transformers

    special = {"bos_token_id": 0, "eos_token_id": None, "pad_token_id": 0}
    yield transformers.GPT2LMHeadModel(transformers.GPT2Config(
        vocab_size=VOCABULARY, n_positions=128, n_embd=256, n_layer=4, n_head=4, **special))
    yield transformers.LlamaForCausalLM(transformers.LlamaConfig(
        vocab_size=VOCABULARY, hidden_size=256, intermediate_size=704, num_hidden_layers=4,
        num_attention_heads=4, num_key_value_heads=2, max_position_embeddings=128, **special))


def program(outputs):
    # Only a warning: what the library calls is not all known here. The bare rows show that it is
    # deterministic.
    torch = parts.pinned_torch(warn_only=True)
    prompt = torch.randint(1, VOCABULARY, (2, 16)).cuda()
    with torch.inference_mode():
        for model in models():
            model = model.eval().cuda()
            # A cache of fixed size is compiled by default, which another test does.
            for cache in ({}, {"cache_implementation": "static", "disable_compile": True}):
                generated = model.generate(
                    prompt, attention_mask=torch.ones_like(prompt), do_sample=False,
                    min_new_tokens=NEW_TOKENS, max_new_tokens=NEW_TOKENS, output_logits=True,
                    return_dict_in_generate=True, **cache)
                outputs.append(generated.sequences.cpu().numpy().tobytes())
                parts.collect(outputs, torch.stack(generated.logits))


if __name__ == "__main__":
    equality.main(__file__, ["torch", "transformers"], program,
                  environment=lambda: {**parts.ENVIRONMENT, "HF_HUB_OFFLINE": "1",
                                       "TRANSFORMERS_VERBOSITY": "error"})
