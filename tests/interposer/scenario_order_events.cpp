// SPDX-License-Identifier: Apache-2.0
//
// Order of events of every kind, and semaphores of which there are none.
#include "tests/interposer/mixer.h"

namespace twin {
namespace {

int events(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        const CUstream other = make_stream();
        CUevent begin = nullptr, end = nullptr, untimed = nullptr;
        STEP(cuEventCreate(&begin, CU_EVENT_DEFAULT));
        STEP(cuEventCreate(&end, CU_EVENT_BLOCKING_SYNC));
        STEP(cuEventCreate(&untimed, CU_EVENT_DISABLE_TIMING));
        STEP(cuEventRecord(begin, stream));
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(1, stream));
        STEP(cuEventRecordWithFlags(end, stream, CU_EVENT_RECORD_DEFAULT));
        STEP(cuStreamWaitEvent(other, end, CU_EVENT_WAIT_DEFAULT));
        STEP(mixer.launch(2, other));
        STEP(cuEventRecord(untimed, other));
        STEP(cuStreamWaitEvent(stream, untimed, CU_EVENT_WAIT_DEFAULT));
        STEP(mixer.launch(3, stream));
        STEP(cuEventSynchronize(end));
        STEP(cuEventQuery(end));
        float milliseconds = -1;
        STEP(cuEventElapsedTime(&milliseconds, begin, end));
        say("time passed: %d", milliseconds > 0);
        STEP(cuEventElapsedTime(&milliseconds, begin, untimed));
        STEP(cuEventSynchronize(untimed));
        STEP(cuStreamSynchronize(stream));
        // Recorded again: an old wait is for the old record.
        STEP(cuEventRecord(untimed, stream));
        STEP(cuStreamSynchronize(stream));
        STEP(cuEventQuery(untimed));
        for (CUevent event : {begin, end, untimed}) STEP(cuEventDestroy(event));
        STEP(cuStreamDestroy(other));
    });
}

// None to use: what the calls answer.
int semaphores(const Arguments&) {
    using Signal = CUresult(const CUexternalSemaphore*,
                            const CUDA_EXTERNAL_SEMAPHORE_SIGNAL_PARAMS*, unsigned, CUstream);
    using Wait = CUresult(const CUexternalSemaphore*, const CUDA_EXTERNAL_SEMAPHORE_WAIT_PARAMS*,
                          unsigned, CUstream);
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        auto* const signal = find<Signal>("cuSignalExternalSemaphoresAsync", 10000);
        auto* const wait = find<Wait>("cuWaitExternalSemaphoresAsync", 10000);
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(1, stream));
        if (signal) STEP(signal(nullptr, nullptr, 0, stream));
        if (wait) STEP(wait(nullptr, nullptr, 0, stream));
        STEP(mixer.launch(2, stream));
        STEP(cuStreamSynchronize(stream));
    });
}

const Scenario s1("order_events", events), s2("order_semaphores", semaphores);

}  // namespace
}  // namespace twin
