/* SPDX-License-Identifier: Apache-2.0
 *
 * The exported entry points: each jumps through its slot, which points to its implementation until
 * injected_errors.cpp turns it to its checked path. That asks whether this call is to fail, and
 * otherwise goes on with all arguments as they were. (No cu function takes more than pointers and
 * integers, so no vector register is saved.)
 */
    .altmacro
    .set entry_index, 0

    .macro entry symbol index
    .text
    .globl \symbol
    .type \symbol, @function
    .balign 16
\symbol:
    .cfi_startproc
    endbr64
    jmp *simgpu_entry_slots_table+8*\index(%rip)
    .cfi_endproc
    .size \symbol, .-\symbol
    .balign 16
checked_\symbol:
    .cfi_startproc
    endbr64
    movl $\index, %eax
    jmp checked_call
    .cfi_endproc

    .data
    .quad impl_\symbol
    .section .data.rel.ro.implementations, "aw"
    .quad impl_\symbol
    .section .data.rel.ro.checked, "aw"
    .quad checked_\symbol
    .set entry_index, entry_index+1
    .endm

    .data
    .balign 8
    .globl simgpu_entry_slots_table
    .hidden simgpu_entry_slots_table
simgpu_entry_slots_table:
    .section .data.rel.ro.implementations, "aw"
    .balign 8
implementations:
    .section .data.rel.ro.checked, "aw"
    .balign 8
    .globl simgpu_entry_checked_table
    .hidden simgpu_entry_checked_table
simgpu_entry_checked_table:

#define SIMGPU_ENTRY(name, version, flavour, symbol) entry symbol %entry_index
#include "tools/simgpu/api/proc_address_table.inc"
#undef SIMGPU_ENTRY

    .text
    .type checked_call, @function
    .balign 16
checked_call:
    .cfi_startproc
    pushq %rdi
    .cfi_adjust_cfa_offset 8
    pushq %rsi
    .cfi_adjust_cfa_offset 8
    pushq %rdx
    .cfi_adjust_cfa_offset 8
    pushq %rcx
    .cfi_adjust_cfa_offset 8
    pushq %r8
    .cfi_adjust_cfa_offset 8
    pushq %r9
    .cfi_adjust_cfa_offset 8
    pushq %rax
    .cfi_adjust_cfa_offset 8
    movl %eax, %edi
    call simgpu_injected_error
    cmpl $-1, %eax
    popq %r10
    .cfi_adjust_cfa_offset -8
    popq %r9
    .cfi_adjust_cfa_offset -8
    popq %r8
    .cfi_adjust_cfa_offset -8
    popq %rcx
    .cfi_adjust_cfa_offset -8
    popq %rdx
    .cfi_adjust_cfa_offset -8
    popq %rsi
    .cfi_adjust_cfa_offset -8
    popq %rdi
    .cfi_adjust_cfa_offset -8
    je 1f
    ret
1:
    leaq implementations(%rip), %r11
    jmp *(%r11,%r10,8)
    .cfi_endproc
    .size checked_call, .-checked_call

    .section .note.GNU-stack, "", @progbits
