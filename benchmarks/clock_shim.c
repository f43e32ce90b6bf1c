/* Preloaded, this library sets the system clock of one process: CLOCK_REALTIME is ahead by the double, s, in the file of the
   environment variable CLOCK_SHIM, which another process may change at any time.

   As the kernel does, it wakes a wait until a time of that clock when the clock, as set, reaches that time: a wait is cut into
   slices of 10 ms. Waits by the steady clock are left alone. */
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

#define SLICE 0.01
#define EPOCH 500000000L /* a time before this one, in 1985, is by the steady clock */

static double ahead(void) {
  static volatile double *shared;
  static int tried;
  if (!tried) {
    const char *path = getenv("CLOCK_SHIM");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *mapped = file < 0 ? MAP_FAILED : mmap(NULL, sizeof(double), PROT_READ, MAP_SHARED, file, 0);
    if (mapped != MAP_FAILED) shared = mapped;
    if (file >= 0) close(file);
    tried = 1;
  }
  return shared ? *shared : 0.0;
}

static struct timespec later(struct timespec time, double seconds) {
  double whole = floor(seconds);
  time.tv_sec += (time_t)whole;
  time.tv_nsec += (long)((seconds - whole) * 1e9);
  if (time.tv_nsec >= 1000000000L) time.tv_nsec -= 1000000000L, time.tv_sec++;
  return time;
}

static struct timespec true_time(clockid_t clock) {
  struct timespec time;
  syscall(SYS_clock_gettime, clock, &time);
  return time;
}

int clock_gettime(clockid_t clock, struct timespec *time) {
  int failed = syscall(SYS_clock_gettime, clock, time);
  if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) *time = later(*time, ahead());
  return failed;
}

int gettimeofday(struct timeval *restrict time, void *restrict zone) {
  struct timespec now;
  (void)zone;
  clock_gettime(CLOCK_REALTIME, &now);
  time->tv_sec = now.tv_sec, time->tv_usec = now.tv_nsec / 1000;
  return 0;
}

time_t time(time_t *stored) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (stored) *stored = now.tv_sec;
  return now.tv_sec;
}

/* Returns the end of the next slice of a wait, in true time; a time in the past if the wait is over. */
static struct timespec slice(const struct timespec *until, int *over) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  double left = (double)(until->tv_sec - now.tv_sec) + (until->tv_nsec - now.tv_nsec) * 1e-9;
  *over = left <= 0.0;
  return later(true_time(CLOCK_REALTIME), *over ? -1.0 : fmin(left, SLICE));
}

#define WAIT(CALL, TIMED_OUT)                       \
  if (until->tv_sec < EPOCH) {                      \
    struct timespec end = *until;                   \
    return CALL;                                    \
  }                                                 \
  for (;;) {                                        \
    int over;                                       \
    struct timespec end = slice(until, &over);      \
    int result = CALL;                              \
    if (over || !(TIMED_OUT)) return result;        \
  }

int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex, const struct timespec *until) {
  static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
  if (!real) real = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2"); /* not the older one of x86-64 */
  if (!real) real = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
  WAIT(real(cond, mutex, &end), result == ETIMEDOUT)
}

int pthread_cond_clockwait(pthread_cond_t *cond, pthread_mutex_t *mutex, clockid_t clock, const struct timespec *until) {
  static int (*real)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);
  if (!real) real = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
  if (clock != CLOCK_REALTIME) return real(cond, mutex, clock, until);
  WAIT(real(cond, mutex, clock, &end), result == ETIMEDOUT)
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *until) {
  static int (*real)(pthread_mutex_t *, const struct timespec *);
  if (!real) real = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
  WAIT(real(mutex, &end), result == ETIMEDOUT)
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until) {
  static int (*real)(sem_t *, const struct timespec *);
  if (!real) real = dlsym(RTLD_NEXT, "sem_timedwait");
  WAIT(real(semaphore, &end), result && errno == ETIMEDOUT)
}
