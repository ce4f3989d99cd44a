# SPDX-License-Identifier: Apache-2.0
# urgengo_compile_gpu_programs(<target> <file.cu>...)
# Compiles programs that scripts compile again where there is a GPU, and executes none: what they
# include changes where there is none. Not where device code is compiled for one GPU alone.
function(urgengo_compile_gpu_programs target)
  if(URGENGO_ONE_GPU_ARCHITECTURE)
    return()
  endif()
  set(_objects)
  foreach(_source IN LISTS ARGN)
    set(_object "${CMAKE_CURRENT_BINARY_DIR}/${_source}.o")
    add_custom_command(
      OUTPUT "${_object}"
      COMMAND "${CUDAToolkit_NVCC_EXECUTABLE}" -c -std=c++20 --expt-relaxed-constexpr -O0
              -MD -MF "${_object}.d" -I "${CMAKE_SOURCE_DIR}" -I "${CMAKE_SOURCE_DIR}/include"
              -o "${_object}" "${CMAKE_CURRENT_SOURCE_DIR}/${_source}"
      DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/${_source}"
      DEPFILE "${_object}.d"
      COMMENT "nvcc ${_source}"
      VERBATIM)
    list(APPEND _objects "${_object}")
  endforeach()
  add_custom_target(${target} ALL DEPENDS ${_objects})
endfunction()
