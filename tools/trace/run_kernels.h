// SPDX-License-Identifier: Apache-2.0
//
// Which kernels a task's launches are of, by its plan: a run's conditions have their names
// (interposer/run_conditions.h). A frame that goes otherwise than planned launches others.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/trace/run_pieces.h"

namespace urgengo::trace {

class PlannedKernelNames {
  public:
    /// Nothing in the conditions is believed: what is not as it should be is left out.
    explicit PlannedKernelNames(const Run& run);

    /// @returns "conv", or "conv, relu, ...": the names of the piece's launches, each once, a few
    /// of
    ///          them; empty if they are not known
    std::string of(const RunPiece& piece) const;

  private:
    std::vector<std::string> names_;
    std::vector<std::vector<std::size_t>> launches_;  ///< by task: indices of names
};

}  // namespace urgengo::trace
