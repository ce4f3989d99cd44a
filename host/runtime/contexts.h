// SPDX-License-Identifier: Apache-2.0
//
// What goes with the program's modules and contexts: names of kernels, streams, marks, gates.
//
// @threads any
#pragma once

#include "host/runtime/common.h"

namespace urgengo::runtime {

class Contexts {
  public:
    /// @param common  outlives it
    explicit Contexts(Common& common) : common_(common) {}

    /// A module was unloaded: kernel handles may come to mean other kernels.
    void forget_names() {
        common_.kernels.forget();
        common_.governor.tasks().changed();
    }
    /// Before a context goes, or may go, with its streams.
    void ends(const exec::EndingContext& ending) {
        forget_names();
        common_.streams.context_ends();
        common_.marks.context_ends(ending);
        common_.gate_keeper.context_ends(ending);
    }
    /// After it.
    void ended(const exec::EndingContext& ending) {
        ends(ending);
        common_.streams.context_ended();
        common_.marks.context_ended(
            ending, [this](unsigned long long id) { common_.streams.pool().context_ended(id); });
        common_.gate_keeper.context_ended(ending);
    }

  private:
    Common& common_;
};

}  // namespace urgengo::runtime
