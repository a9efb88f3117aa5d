/* Preloaded into a recording: its realtime clock, and no other's, is set CLOCK_STEP_MS further CLOCK_STEP_AFTER_MS after
 * the first look at it. */
#define _GNU_SOURCE
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static long long milliseconds(const char *name) {
    const char *text = getenv(name);
    return text ? atoll(text) : 0;
}

int clock_gettime(clockid_t clock, struct timespec *time) {
    static atomic_llong first_ns;
    int failed = syscall(SYS_clock_gettime, clock, time);
    if (failed || clock != CLOCK_REALTIME) return failed;
    struct timespec now;
    syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now);
    long long now_ns = now.tv_sec * 1000000000LL + now.tv_nsec, none = 0;
    atomic_compare_exchange_strong(&first_ns, &none, now_ns);
    if (now_ns - atomic_load(&first_ns) < milliseconds("CLOCK_STEP_AFTER_MS") * 1000000) return 0;
    long long set_ns = time->tv_sec * 1000000000LL + time->tv_nsec + milliseconds("CLOCK_STEP_MS") * 1000000;
    time->tv_sec = set_ns / 1000000000;
    time->tv_nsec = set_ns % 1000000000;
    return 0;
}
