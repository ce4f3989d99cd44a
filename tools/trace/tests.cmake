# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
if(TARGET urgengo::trace)
  urgengo_add_tests(urgengo_trace_tests LABEL unit
    SOURCES
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_cupti.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_instances.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_rules.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_kernel_times.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_pace.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_profile.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_reader.cpp"
    LINK urgengo::trace urgengo::config_reader)
endif()
if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_profile_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_cmd_profile.cpp"
    LINK urgengo::commands)
endif()
