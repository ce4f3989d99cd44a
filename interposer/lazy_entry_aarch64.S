// SPDX-License-Identifier: Apache-2.0
//
// urgengo_lazy_entry for AArch64: see lazy_entry_x86_64.S. The stub that jumps here has put the
// entry's index into w17. Saves x0-x8, q0-q7 and the return address, loads the driver, and enters
// the real function through x16, as a procedure linkage table does.
//
// Run in an emulator only (tools/check_aarch64): no machine of this kind was at hand.

    .text
    .globl urgengo_lazy_entry
    .hidden urgengo_lazy_entry
    .type urgengo_lazy_entry, %function
    .balign 16
urgengo_lazy_entry:
    .cfi_startproc
    stp x29, x30, [sp, #-224]!
    .cfi_def_cfa_offset 224
    .cfi_offset x29, -224
    .cfi_offset x30, -216
    mov x29, sp
    stp x0, x1, [sp, #16]
    stp x2, x3, [sp, #32]
    stp x4, x5, [sp, #48]
    stp x6, x7, [sp, #64]
    str x8, [sp, #80]
    stp q0, q1, [sp, #96]
    stp q2, q3, [sp, #128]
    stp q4, q5, [sp, #160]
    stp q6, q7, [sp, #192]
    mov x1, x0
    mov w0, w17
    bl urgengo_resolve_entry
    mov x16, x0
    ldp q6, q7, [sp, #192]
    ldp q4, q5, [sp, #160]
    ldp q2, q3, [sp, #128]
    ldp q0, q1, [sp, #96]
    ldr x8, [sp, #80]
    ldp x6, x7, [sp, #64]
    ldp x4, x5, [sp, #48]
    ldp x2, x3, [sp, #32]
    ldp x0, x1, [sp, #16]
    ldp x29, x30, [sp], #224
    .cfi_def_cfa_offset 0
    .cfi_restore x29
    .cfi_restore x30
    br x16
    .cfi_endproc
    .size urgengo_lazy_entry, .-urgengo_lazy_entry
    .section .note.GNU-stack,"",%progbits
