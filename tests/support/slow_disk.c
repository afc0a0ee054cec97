/* Preloaded into a process, it makes the disk slow: each sync takes SLOW_DISK seconds.
 *
 * SLOW_DISK_FILE, if it is set, names a file that must be there for that, so that a test makes the
 * disk of a running process slow or quick.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static void take_time(void) {
  const char *seconds = getenv("SLOW_DISK"), *file = getenv("SLOW_DISK_FILE");
  double left = seconds && (!file || access(file, F_OK) == 0) ? atof(seconds) : 0.0;
  struct timespec rest = {(time_t)left, (long)((left - (time_t)left) * 1e9)};
  /* A disk does not hurry for a signal. */
  while (nanosleep(&rest, &rest) != 0) continue;
}

int fsync(int file) {
  static int (*real)(int);
  if (!real) *(void **)&real = dlsym(RTLD_NEXT, "fsync");
  take_time();
  return real(file);
}

int fdatasync(int file) {
  static int (*real)(int);
  if (!real) *(void **)&real = dlsym(RTLD_NEXT, "fdatasync");
  take_time();
  return real(file);
}
