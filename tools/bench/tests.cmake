# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_call_bench_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_bench_calls.cpp"
    LINK urgengo::cli)
endif()

# Whether the benchmark still measures what it says, not how much: it refuses launches that were
# held or not scheduled.
if(TARGET urgengo_call_bench AND NOT URGENGO_SANITIZE)
  add_test(NAME "urgengo bench calls times scheduled launches that wait for nobody"
    COMMAND urgengo bench calls --rounds 1 --min-seconds 0.001 --chains 1,3)
  set_tests_properties("urgengo bench calls times scheduled launches that wait for nobody"
    PROPERTIES LABELS interposer TIMEOUT 120 PASS_REGULAR_EXPRESSION "scheduled/by_name/cuLaunchKernelEx +3 chains +[0-9]")
endif()
