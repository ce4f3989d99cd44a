# SPDX-License-Identifier: Apache-2.0
# The simulated GPU's tests; included by tests/unit/CMakeLists.txt.
# The engine in virtual time, and what it is made of: no thread, no clock.
urgengo_add_tests(urgengo_simgpu_engine_tests LABEL unit
  SOURCES
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_cost_table.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_engine.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_part.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_sm_array.cpp
  LINK urgengo_simgpu_core)
# The driver API, in real time, as a program sees it.
urgengo_add_tests(urgengo_simgpu_tests LABEL unit
  SOURCES
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_context.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_launch.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_memory.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_proc_address.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_stream.cpp
  LINK urgengo_simgpu)
target_include_directories(urgengo_simgpu_tests SYSTEM PRIVATE ${CUDAToolkit_INCLUDE_DIRS})
# What the environment chooses for a whole process.
urgengo_add_tests(urgengo_simgpu_zero_cost_tests LABEL unit
  SOURCES ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_zero_cost.cpp
  LINK urgengo_simgpu)
target_include_directories(urgengo_simgpu_zero_cost_tests SYSTEM PRIVATE ${CUDAToolkit_INCLUDE_DIRS})
