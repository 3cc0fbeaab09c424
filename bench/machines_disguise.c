/* A processor disguised as another: preloaded, it answers the CPUID instruction as that one would.

   Every library that asks the processor what it can do (NumPy, OpenBLAS, MKL, oneDNN, LLVM, Embree, Cycles)
   then takes the path it would take there. The kernel must let CPUID fault (Linux's arch_prctl). What the C
   library chose before this was loaded is set apart, by GLIBC_TUNABLES. OBJECTFOLDER_DISGUISE names the
   processor: skylakex, haswell, zen2 or nehalem. */

#define _GNU_SOURCE
#include <cpuid.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>

#define ARCH_SET_CPUID 0x1012
#define HASWELL_7 0x000007a9u /* fsgsbase, bmi1, avx2, smep, bmi2, erms, invpcid */
#define SKYLAKEX_7 (HASWELL_7 | 0xd19f0000u) /* and adx, rdseed, clwb, avx512 f, dq, cd, bw, vl */
#define ZEN2_7 (HASWELL_7 & ~0x400u)
#define VECTORS_1 0x3c401000u /* fma, movbe, osxsave, avx, f16c, rdrand */
#define XSAVE_1 0x04000000u

struct processor {
    const char *name;
    const char *vendor;
    uint32_t signature; /* family, model, stepping */
    uint32_t leaf_1_ecx_without;
    uint32_t leaf_7_ebx;
};

static const struct processor PROCESSORS[] = {
    {"skylakex", "GenuineIntel", 0x00050654, 0, SKYLAKEX_7},
    {"haswell", "GenuineIntel", 0x000306c3, 0, HASWELL_7},
    {"zen2", "AuthenticAMD", 0x00830f10, 0, ZEN2_7},
    {"nehalem", "GenuineIntel", 0x000106a5, VECTORS_1 | XSAVE_1, 0},
};
static const struct processor *played;

static void answer(uint32_t leaf, uint32_t subleaf, uint32_t out[4]) {
    __cpuid_count(leaf, subleaf, out[0], out[1], out[2], out[3]);
    switch (leaf) {
    case 0:
        memcpy(&out[1], played->vendor, 4);
        memcpy(&out[3], played->vendor + 4, 4);
        memcpy(&out[2], played->vendor + 8, 4);
        break;
    case 1:
        out[0] = played->signature;
        out[2] &= ~played->leaf_1_ecx_without;
        break;
    case 7:
        out[1] = subleaf == 0 ? out[1] & played->leaf_7_ebx : 0;
        out[0] = out[2] = out[3] = 0;
        break;
    case 0x14: case 0x19: case 0x1c: case 0x1d: case 0x1e: case 0x24:
        out[0] = out[1] = out[2] = out[3] = 0;
        break;
    case 0x80000001u:
        if (played->leaf_7_ebx == 0) out[2] &= ~0x20u; /* lzcnt */
        break;
    }
}

static void on_fault(int number, siginfo_t *info, void *context) {
    greg_t *registers = ((ucontext_t *)context)->uc_mcontext.gregs;
    const uint8_t *code = (const uint8_t *)registers[REG_RIP];
    if (info->si_code != SI_KERNEL || code[0] != 0x0f || code[1] != 0xa2) {
        signal(number, SIG_DFL); /* a fault of the program's own: let it come again */
        return;
    }
    uint32_t out[4];
    syscall(SYS_arch_prctl, ARCH_SET_CPUID, 1);
    answer((uint32_t)registers[REG_RAX], (uint32_t)registers[REG_RCX], out);
    syscall(SYS_arch_prctl, ARCH_SET_CPUID, 0);
    registers[REG_RAX] = out[0];
    registers[REG_RBX] = out[1];
    registers[REG_RCX] = out[2];
    registers[REG_RDX] = out[3];
    registers[REG_RIP] += 2;
}

__attribute__((constructor)) static void disguise(void) {
    const char *name = getenv("OBJECTFOLDER_DISGUISE");
    for (size_t index = 0; name && index < sizeof PROCESSORS / sizeof *PROCESSORS; index++)
        if (!strcmp(PROCESSORS[index].name, name)) played = &PROCESSORS[index];
    if (!played) return;
    struct sigaction action = {.sa_sigaction = on_fault, .sa_flags = SA_SIGINFO | SA_NODEFER};
    sigaction(SIGSEGV, &action, NULL);
    if (syscall(SYS_arch_prctl, ARCH_SET_CPUID, 0)) _exit(77); /* no disguise: say so, measure nothing */
}
