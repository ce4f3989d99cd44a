// SPDX-License-Identifier: Apache-2.0
//
// The tests' main for Catch2 2.13.
#define CATCH_CONFIG_MAIN
#include <catch2/catch.hpp>
