/* Sets the system clock of one process while it runs: preload it, and name in FAULTS_CLOCK a file whose first double is the
 * offset, s. Waits until a time of the system clock follows its steps, as in the kernel: they look at it every 20 ms. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SLICE 0.02

static double offset(void) {
    static volatile double *shared;
    static int looked;
    if (!looked) {
        const char *path = getenv("FAULTS_CLOCK");
        int file = path ? open(path, O_RDONLY) : -1;
        looked = 1;
        if (file >= 0) {
            void *page = mmap(0, sizeof(double), PROT_READ, MAP_SHARED, file, 0);
            if (page != MAP_FAILED) shared = page;
            close(file);
        }
    }
    return shared ? *shared : 0.0;
}

static struct timespec later(struct timespec time, double seconds) {
    double whole = floor(seconds);
    time.tv_sec += (time_t)whole;
    time.tv_nsec += (long)((seconds - whole) * 1e9);
    if (time.tv_nsec >= 1000000000L) {
        time.tv_nsec -= 1000000000L;
        time.tv_sec++;
    }
    return time;
}

static struct timespec kernels(void) {
    struct timespec time;
    syscall(SYS_clock_gettime, CLOCK_REALTIME, &time);
    return time;
}

int clock_gettime(clockid_t clock, struct timespec *time) {
    int result = syscall(SYS_clock_gettime, clock, time);
    if (!result && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) *time = later(*time, offset());
    return result;
}

int gettimeofday(struct timeval *time, void *zone) {
    struct timespec now = later(kernels(), offset());
    (void)zone;
    time->tv_sec = now.tv_sec;
    time->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *result) {
    time_t now = later(kernels(), offset()).tv_sec;
    if (result) *result = now;
    return now;
}

static double left(const struct timespec *until) {
    struct timespec now = later(kernels(), offset());
    return (double)(until->tv_sec - now.tv_sec) + 1e-9 * (double)(until->tv_nsec - now.tv_nsec);
}

/* Waits in slices by the kernel's clock until the time has come by the process's clock. */
#define WAIT(CALL)                                                             \
    for (;;) {                                                                 \
        double rest = left(until);                                             \
        struct timespec slice = later(kernels(), fmin(fmax(rest, 0.0), SLICE)); \
        int result = CALL;                                                     \
        if (rest <= 0.0 || !TIMED_OUT(result)) return result;                  \
    }

#define TIMED_OUT(result) ((result) == ETIMEDOUT)

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until) {
    static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    if (!real) real = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2"); /* an older one exists on x86 */
    if (!real) real = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    if (until->tv_sec < 500000000L) return real(condition, mutex, until); /* of the steady clock */
    WAIT(real(condition, mutex, &slice))
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock, const struct timespec *until) {
    static int (*real)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);
    if (!real) real = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
    if (clock != CLOCK_REALTIME) return real(condition, mutex, clock, until);
    WAIT(real(condition, mutex, clock, &slice))
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *until) {
    static int (*real)(pthread_mutex_t *, const struct timespec *);
    if (!real) real = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
    WAIT(real(mutex, &slice))
}

#undef TIMED_OUT
#define TIMED_OUT(result) ((result) != 0 && errno == ETIMEDOUT)

int sem_timedwait(sem_t *semaphore, const struct timespec *until) {
    static int (*real)(sem_t *, const struct timespec *);
    if (!real) real = dlsym(RTLD_NEXT, "sem_timedwait");
    WAIT(real(semaphore, &slice))
}
