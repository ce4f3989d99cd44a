// SPDX-License-Identifier: Apache-2.0
//
// Gives every function that a program may call the symbol impl_<name>: the exported one of its own
// name is an entry in entries_x86_64.S, which may be told to fail (injected_errors.h). Calls inside
// the library so never count as the program's. Must come before cuda.h, and so before
// CUDA_VERSION is known: a name too many does no harm.
#pragma once

#ifdef CUDA_VERSION
#error "cuda.h came before entry_names.h: its functions keep their names"
#endif

#define SIMGPU_EVERY_NAME
#define SIMGPU_TEXT(x) #x
#define SIMGPU_ENTRY(name, version, flavour, symbol) \
    _Pragma(SIMGPU_TEXT(redefine_extname symbol impl_##symbol))
#include "tools/simgpu/api/proc_address_table.inc"
#undef SIMGPU_ENTRY
#undef SIMGPU_TEXT
#undef SIMGPU_EVERY_NAME
