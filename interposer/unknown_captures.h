// SPDX-License-Identifier: Apache-2.0
//
// Ways to begin a capture that are newer than we are (cuStreamBeginRecaptureToGraph of CUDA 13.3,
// say): we do not export them, so cuGetProcAddress alone leads to them. The program gets a few
// instructions of ours that note the capture and jump on, whatever the function's other arguments
// are. Only a call tells that a program captures: CUDA's runtime asks for every entry in every
// process.
//
// How the call ends is not seen. A capture that did not begin counts until its stream is gone:
// launches ask the driver about their stream then, and are scheduled as usual where it does not
// capture.
#pragma once

#include <cuda.h>

namespace urgengo::interposer {

/// @param function  the driver's answer, which it does not export under a name that we know
/// @returns what to give the program: `function` itself, unless its name says that it begins a
///          capture
void* noting_captures(void* function, const char* name, cuuint64_t flags);

/// @returns the driver's function behind the entry of that index, which is about to be called
void* note_capture(int index, CUstream stream);

}  // namespace urgengo::interposer
