# SPDX-License-Identifier: Apache-2.0
# urgengo_compile_gpu_programs(<target> <file.cu>...)
# Compiles programs that scripts compile again where there is a GPU, and executes none: what they
# include changes where there is none. To PTX alone, which takes a third of the time: that pass checks
# the host's code, too. Not where device code is compiled for one GPU alone.
function(urgengo_compile_gpu_programs target)
  if(URGENGO_ONE_GPU_ARCHITECTURE)
    return()
  endif()
  set(_texts)
  foreach(_source IN LISTS ARGN)
    set(_text "${CMAKE_CURRENT_BINARY_DIR}/${_source}.ptx")
    add_custom_command(
      OUTPUT "${_text}"
      COMMAND "${CUDAToolkit_NVCC_EXECUTABLE}" -ptx -std=c++20 --expt-relaxed-constexpr -O0
              -MD -MF "${_text}.d" -I "${CMAKE_SOURCE_DIR}" -I "${CMAKE_SOURCE_DIR}/include"
              -o "${_text}" "${CMAKE_CURRENT_SOURCE_DIR}/${_source}"
      DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/${_source}"
      DEPFILE "${_text}.d"
      COMMENT "nvcc ${_source}"
      VERBATIM)
    list(APPEND _texts "${_text}")
  endforeach()
  add_custom_target(${target} ALL DEPENDS ${_texts})
endfunction()
