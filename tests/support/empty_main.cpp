// SPDX-License-Identifier: Apache-2.0
//
// A program that does nothing: urgengo_test_headers needs one to have its headers precompiled with
// the flags of a test program. No test runs it, and it links nothing of UrgenGo.

int main() {
    return 0;
}
