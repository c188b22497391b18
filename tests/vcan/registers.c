/* Lets User-Mode Linux 6.1 start on processors with AMX; preloaded into it.
 *
 * It keeps 2.7 KB of a process's extended registers and hands them back as they are, but a host
 * kernel takes them only whole, AMX tiles included: 11 KB, else EFAULT, and the guest panics. So
 * they are given back within a state of full size. The tiles in it are zero and marked as unused,
 * for the guest knows of none.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

long ptrace(enum __ptrace_request request, ...)
{
    static long (*real)(enum __ptrace_request, ...);
    static char state[1 << 16] __attribute__((aligned(64)));
    static size_t size;
    struct iovec whole = {state, sizeof state};
    va_list rest;

    va_start(rest, request);
    pid_t pid = va_arg(rest, pid_t);
    void *place = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);
    if (!real)
        real = (long (*)(enum __ptrace_request, ...))dlsym(RTLD_NEXT, "ptrace");
    if (request != PTRACE_SETREGSET || (long)place != NT_X86_XSTATE)
        return real(request, pid, place, data);

    if (!size && real(PTRACE_GETREGSET, pid, place, &whole) == 0) {
        size = whole.iov_len;
        memset(state, 0, size);
    }
    struct iovec *given = data;
    if (given->iov_len >= size)
        return real(request, pid, place, given);
    memcpy(state, given->iov_base, given->iov_len);
    whole.iov_len = size;
    return real(request, pid, place, &whole);
}
