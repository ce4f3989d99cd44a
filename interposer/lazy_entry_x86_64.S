// SPDX-License-Identifier: Apache-2.0
//
// urgengo_lazy_entry: where an entry point goes while the real driver is not loaded yet. The stub
// that jumps here has pushed the entry's index. Saves every register that can carry an argument,
// loads the driver, and enters the real function as if it had been called directly.

    .text
    .globl urgengo_lazy_entry
    .hidden urgengo_lazy_entry
    .type urgengo_lazy_entry, @function
    .balign 16
urgengo_lazy_entry:
    .cfi_startproc
    .cfi_def_cfa_offset 16
    pushq %rbp
    .cfi_def_cfa_offset 24
    .cfi_offset rbp, -24
    movq %rsp, %rbp
    .cfi_def_cfa_register rbp
    andq $-16, %rsp
    subq $192, %rsp
    movq %rdi, 0(%rsp)
    movq %rsi, 8(%rsp)
    movq %rdx, 16(%rsp)
    movq %rcx, 24(%rsp)
    movq %r8, 32(%rsp)
    movq %r9, 40(%rsp)
    movq %rax, 48(%rsp)
    movaps %xmm0, 64(%rsp)
    movaps %xmm1, 80(%rsp)
    movaps %xmm2, 96(%rsp)
    movaps %xmm3, 112(%rsp)
    movaps %xmm4, 128(%rsp)
    movaps %xmm5, 144(%rsp)
    movaps %xmm6, 160(%rsp)
    movaps %xmm7, 176(%rsp)
    movq %rdi, %rsi
    movq 8(%rbp), %rdi
    call urgengo_resolve_entry
    movq %rax, %r11
    movq 0(%rsp), %rdi
    movq 8(%rsp), %rsi
    movq 16(%rsp), %rdx
    movq 24(%rsp), %rcx
    movq 32(%rsp), %r8
    movq 40(%rsp), %r9
    movq 48(%rsp), %rax
    movaps 64(%rsp), %xmm0
    movaps 80(%rsp), %xmm1
    movaps 96(%rsp), %xmm2
    movaps 112(%rsp), %xmm3
    movaps 128(%rsp), %xmm4
    movaps 144(%rsp), %xmm5
    movaps 160(%rsp), %xmm6
    movaps 176(%rsp), %xmm7
    leave
    .cfi_def_cfa rsp, 16
    addq $8, %rsp
    .cfi_adjust_cfa_offset -8
    jmp *%r11
    .cfi_endproc
    .size urgengo_lazy_entry, .-urgengo_lazy_entry
    .section .note.GNU-stack,"",%progbits
