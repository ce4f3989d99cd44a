// SPDX-License-Identifier: Apache-2.0
//
// A library that has the name of a tool's, and does nothing.
extern "C" int urgengo_tool_stand_in() {
    return 0;
}
