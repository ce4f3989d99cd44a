// SPDX-License-Identifier: Apache-2.0
//
// An NVTX tool for tests: an injection library that writes a line for each call of NVTX that
// reaches it into the file that NVTX_RECORDER_FILE names, and checks the protocol: domains,
// strings, schemas, counters and time domains are registered before they are used, ranges are
// balanced. What breaks it is a line that begins with "ERROR". Its handles are numbers made of
// names, so that two runs of a program get the same ones, and no program could look into them.
//
// NVTX_RECORDER_LACKS is a list of what it is to be without: init (it refuses), strings (it does
// not listen to registrations), payload, counters, extensions (no module at all).
#pragma once

#ifndef NVTX_NO_IMPL
#define NVTX_NO_IMPL
#endif
#include <nvtx3/nvToolsExtCounters.h>
#include <nvtx3/nvToolsExtPayload.h>

#include <cstdint>
#include <string>

namespace recorder {

bool lacks(const char* what);

/// Writes one line: printf without a newline at the end.
__attribute__((format(printf, 1, 2))) void say(const char* format, ...);
/// The same for what breaks the protocol.
__attribute__((format(printf, 1, 2))) void wrong(const char* format, ...);

/// @returns a number for what was registered under that name, noted as such
std::uint64_t add(const char* kind, nvtxDomainHandle_t domain, const std::string& name);
/// @returns the name that the number was given for; says what is wrong if there is none
std::string name_of(const char* kind, nvtxDomainHandle_t domain, std::uint64_t number);
/// "": the default domain.
std::string domain_name(nvtxDomainHandle_t domain);
std::string message(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event);

/// @returns the depth, as the program gets it
int push(nvtxDomainHandle_t domain);
int pop(nvtxDomainHandle_t domain);
nvtxRangeId_t start(nvtxDomainHandle_t domain);
void end(nvtxDomainHandle_t domain, nvtxRangeId_t id);

/// " {chain: lidar, late: 17}" for each of the payloads
std::string payloads(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data, std::size_t count);

}  // namespace recorder
