# SPDX-License-Identifier: Apache-2.0
# The simulated GPU's tests; included by tests/unit/CMakeLists.txt.
if(NOT TARGET urgengo_simgpu)
  return()
endif()
# The engine in virtual time, and what it is made of: no thread, no clock.
urgengo_add_tests(urgengo_simgpu_engine_tests LABEL unit
  SOURCES
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_cost_table.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_engine.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_engine_streams.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_part.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_sm_array.cpp
  LINK urgengo_simgpu_core)
# The driver API, in real time, as a program sees it.
urgengo_add_tests(urgengo_simgpu_tests LABEL unit
  SOURCES
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_capture.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_context.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_graph.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_graph_nodes.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_green_context.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_image.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_launch.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_mem_pool.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_memory.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_memop.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_proc_address.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_stream.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_virtual_memory.cpp
  LINK urgengo_simgpu)
urgengo_unite(urgengo_simgpu_engine_tests urgengo_simgpu_tests)
# Has names in common with test_simgpu_memory.cpp.
set_source_files_properties("${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_virtual_memory.cpp"
  PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
# What the environment chooses for a whole process.
urgengo_add_tests(urgengo_simgpu_zero_cost_tests LABEL unit
  SOURCES ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_zero_cost.cpp
  LINK urgengo_simgpu)
urgengo_add_tests(urgengo_simgpu_integrated_tests LABEL unit
  SOURCES ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_integrated.cpp
  LINK urgengo_simgpu)
urgengo_add_tests(urgengo_simgpu_devices_tests LABEL unit
  SOURCES ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_devices.cpp
  LINK urgengo_simgpu)
# Libraries that the test opens itself.
urgengo_add_tests(urgengo_simgpu_presets_tests LABEL unit
  SOURCES
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_injected_errors.cpp
    ${CMAKE_SOURCE_DIR}/tests/unit/test_simgpu_presets.cpp
  LINK urgengo_simgpu_core ${CMAKE_DL_LIBS})
add_dependencies(urgengo_simgpu_presets_tests
  urgengo_simgpu urgengo_simgpu_12_4 urgengo_simgpu_12_0)
target_compile_definitions(urgengo_simgpu_presets_tests PRIVATE
  SIMGPU_13_0="$<TARGET_FILE:urgengo_simgpu>"
  SIMGPU_12_4="$<TARGET_FILE:urgengo_simgpu_12_4>"
  SIMGPU_12_0="$<TARGET_FILE:urgengo_simgpu_12_0>")
foreach(_tests urgengo_simgpu_tests urgengo_simgpu_zero_cost_tests urgengo_simgpu_integrated_tests
    urgengo_simgpu_devices_tests urgengo_simgpu_presets_tests)
  target_include_directories(${_tests} SYSTEM PRIVATE ${CUDAToolkit_INCLUDE_DIRS})
endforeach()
# What nvcc makes of one file, in every form that the simulated driver reads.
set(_images "${CMAKE_CURRENT_BINARY_DIR}/simgpu_images")
set(_kernels "${CMAKE_SOURCE_DIR}/tests/unit/data/image_kernels.cu")
set(_nvcc "${CUDAToolkit_NVCC_EXECUTABLE}" "${_kernels}")
set(_both -gencode arch=compute_80,code=sm_80 -gencode arch=compute_80,code=compute_80)
add_custom_command(
  OUTPUT "${_images}/made"
  COMMAND ${CMAKE_COMMAND} -E make_directory "${_images}"
  COMMAND ${_nvcc} -cubin -arch=sm_80 -o "${_images}/old.cubin"
  COMMAND ${_nvcc} -cubin -arch=sm_90 -o "${_images}/new.cubin"
  COMMAND ${_nvcc} -ptx -arch=compute_80 -o "${_images}/kernels.ptx"
  COMMAND ${_nvcc} -fatbin --no-compress ${_both} -o "${_images}/plain.fatbin"
  COMMAND ${_nvcc} -fatbin ${_both} -Xfatbin=-compress-all -o "${_images}/compressed.fatbin"
  COMMAND ${CMAKE_COMMAND} -E touch "${_images}/made"
  DEPENDS "${_kernels}"
  COMMENT "nvcc image_kernels.cu"
  VERBATIM)
add_custom_target(urgengo_simgpu_images DEPENDS "${_images}/made")
add_dependencies(urgengo_simgpu_tests urgengo_simgpu_images)
target_compile_definitions(urgengo_simgpu_tests PRIVATE SIMGPU_IMAGES="${_images}")
