# SPDX-License-Identifier: Apache-2.0
# urgengo_embed_fatbin(<target> <symbol> <file.cu> [ARCHITECTURES <number>...] [OPTIONS <nvcc's>...])
# Compiles a .cu file to a fat binary (machine code for every architecture that the installed nvcc
# lists, plus PTX of the oldest, for the driver to compile on any that is none of them) and embeds it
# in <target> as `extern "C" const unsigned char <symbol>[]`, ended by <symbol>_end. The image is
# loaded through the driver API; cudart is never linked.
option(URGENGO_ONE_GPU_ARCHITECTURE
  "Compile device code for the oldest GPU alone that nvcc knows: where no GPU executes it" OFF)

# urgengo_gpu_architectures(<variable>): "75;80;...", as nvcc --list-gpu-code lists them, the oldest
# first.
function(urgengo_gpu_architectures variable)
  execute_process(COMMAND "${CUDAToolkit_NVCC_EXECUTABLE}" --list-gpu-code
    OUTPUT_VARIABLE _listed ERROR_VARIABLE _listed RESULT_VARIABLE _status)
  string(REGEX MATCHALL "sm_[0-9]+" _codes "${_listed}")
  list(TRANSFORM _codes REPLACE "sm_" "")
  list(REMOVE_DUPLICATES _codes)
  list(LENGTH _codes _number)
  if(NOT _status EQUAL 0 OR _number LESS 2)
    message(FATAL_ERROR "nvcc --list-gpu-code: found '${_listed}', accepted: sm_<number>, several times")
  endif()
  list(SORT _codes COMPARE NATURAL)
  if(URGENGO_ONE_GPU_ARCHITECTURE)
    list(GET _codes 0 _codes)
  endif()
  set(${variable} "${_codes}" PARENT_SCOPE)
endfunction()

function(urgengo_embed_fatbin target symbol source)
  cmake_parse_arguments(PARSE_ARGV 3 _embed "" "" "ARCHITECTURES;OPTIONS")
  if(NOT _embed_OPTIONS)
    set(_embed_OPTIONS -std=c++17)
  endif()
  get_filename_component(_source "${source}" ABSOLUTE)
  get_filename_component(_name "${source}" NAME_WE)
  set(_fatbin "${CMAKE_CURRENT_BINARY_DIR}/${_name}.fatbin")
  urgengo_gpu_architectures(_architectures)
  list(GET _architectures 0 _oldest)
  set(_code -gencode=arch=compute_${_oldest},code=compute_${_oldest})
  if(_embed_ARCHITECTURES)
    set(_listed ${_architectures})
    set(_architectures)
    foreach(_sm IN LISTS _embed_ARCHITECTURES)
      if(_sm IN_LIST _listed)
        list(APPEND _architectures ${_sm})
      endif()
    endforeach()
  endif()
  foreach(_sm IN LISTS _architectures)
    list(APPEND _code -gencode=arch=compute_${_sm},code=sm_${_sm})
  endforeach()
  add_custom_command(
    OUTPUT "${_fatbin}"
    COMMAND "${CUDAToolkit_NVCC_EXECUTABLE}" -fatbin ${_code} ${_embed_OPTIONS} -O2 -MD -MF "${_fatbin}.d"
            -I "${CMAKE_SOURCE_DIR}" -I "${CMAKE_SOURCE_DIR}/include" -o "${_fatbin}" "${_source}"
    DEPENDS "${_source}"
    DEPFILE "${_fatbin}.d"
    COMMENT "nvcc ${_name}.cu"
    VERBATIM)
  urgengo_embed_file(${target} ${symbol} "${_fatbin}")
endfunction()
