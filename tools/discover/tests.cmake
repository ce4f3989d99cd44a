# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
if(TARGET urgengo::discover)
  urgengo_add_tests(urgengo_discover_tests LABEL unit
    SOURCES
      "${CMAKE_SOURCE_DIR}/tests/unit/test_discover_claims.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_discover_draft.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_discover_names.cpp"
    LINK urgengo::discover urgengo::config_reader)
endif()
