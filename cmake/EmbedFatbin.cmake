# SPDX-License-Identifier: Apache-2.0
# urgengo_embed_fatbin(<target> <symbol> <file.cu>)
# Compiles a .cu file to a fat binary (machine code for every major architecture that the installed
# nvcc knows, plus PTX for later ones) and embeds it in <target> as `extern "C" const unsigned char
# <symbol>[]`. The image is loaded through the driver API; cudart is never linked.
function(urgengo_embed_fatbin target symbol source)
  get_filename_component(_source "${source}" ABSOLUTE)
  get_filename_component(_name "${source}" NAME_WE)
  set(_fatbin "${CMAKE_CURRENT_BINARY_DIR}/${_name}.fatbin")
  set(_asm "${CMAKE_CURRENT_BINARY_DIR}/${_name}_fatbin.S")
  add_custom_command(
    OUTPUT "${_fatbin}"
    COMMAND "${CUDAToolkit_NVCC_EXECUTABLE}" -fatbin -arch=all-major -std=c++17 -O2
            -I "${CMAKE_SOURCE_DIR}" -I "${CMAKE_SOURCE_DIR}/include" -o "${_fatbin}" "${_source}"
    DEPENDS "${_source}" ${ARGN}
    COMMENT "nvcc ${_name}.cu"
    VERBATIM)
  file(CONFIGURE OUTPUT "${_asm}" @ONLY CONTENT [[
.section .rodata
.balign 16
.globl @symbol@
.hidden @symbol@
@symbol@:
.incbin "@_fatbin@"
.globl @symbol@_end
.hidden @symbol@_end
@symbol@_end:
.section .note.GNU-stack,"",%progbits
]])
  set_source_files_properties("${_asm}" PROPERTIES OBJECT_DEPENDS "${_fatbin}")
  target_sources(${target} PRIVATE "${_asm}")
endfunction()
