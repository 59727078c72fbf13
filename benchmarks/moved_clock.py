"""The clock of another computer, for single processes: a library in front of libc, as libfaketime is, moves their system clock.

Processes that share a `MovedClock` read the same clock. The kernel's stamps of packets are moved with it, and who sets or steers it
(settime, adjtime) steers this clock, not that of the machine: `ptp4l` with software stamps works on it as on the clock of a computer.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import shutil
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from benchmarks.report import AbsentError

_STATE: Final = struct.Struct("=5q")  # turn, since, ahead, drift, steered, as in the library
_PPM: Final = 65536.0  # the kernel's unit of rates is 2^-16 ppm
_SOURCE: Final = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/timex.h>
#include <time.h>

/* turn is odd while somebody writes; then at a true time t the clock is ahead + (t - since) * (drift + steered) / 2^16 / 10^6 ns ahead. */
static volatile struct { int64_t turn, since, ahead, drift, steered; } *state;
static int (*real_gettime)(clockid_t, struct timespec *);
static ssize_t (*real_recvmsg)(int, struct msghdr *, int);
static int (*real_wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);

__attribute__((constructor)) static void start(void) {
  if (real_gettime) return;
  const char *path = getenv("HANDWAVE_CLOCK");
  int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
  void *found = file < 0 ? MAP_FAILED : mmap(0, sizeof *state, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (found != MAP_FAILED) state = found;
  real_recvmsg = dlsym(RTLD_NEXT, "recvmsg");
  real_wait = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2"); /* dlsym may find the older one, of another ABI */
  if (!real_wait) real_wait = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
  real_gettime = dlsym(RTLD_NEXT, "clock_gettime");
}

static int64_t ahead(int64_t true_ns) {
  int64_t turn, since, moved, rate;
  if (!state) return 0;
  do {
    turn = __atomic_load_n(&state->turn, __ATOMIC_ACQUIRE);
    since = state->since, moved = state->ahead, rate = state->drift + state->steered;
    __atomic_thread_fence(__ATOMIC_ACQUIRE);
  } while (turn % 2 || turn != state->turn);
  return moved + (int64_t)((double)(true_ns - since) * (double)rate / 65536e6);
}

static int64_t whole(const struct timespec *t) { return t->tv_sec * 1000000000LL + t->tv_nsec; }

static void move(struct timespec *t) {
  int64_t ns = whole(t) + ahead(whole(t));
  t->tv_sec = ns / 1000000000, t->tv_nsec = ns % 1000000000;
}

static void set(int64_t true_ns, int64_t moved, int64_t steered) {
  __atomic_fetch_add(&state->turn, 1, __ATOMIC_ACQ_REL);
  state->since = true_ns, state->ahead = moved, state->steered = steered;
  __atomic_fetch_add(&state->turn, 1, __ATOMIC_ACQ_REL);
}

int clock_gettime(clockid_t id, struct timespec *now) {
  start();
  int result = real_gettime(id, now);
  if (!result && id == CLOCK_REALTIME) move(now);
  return result;
}

int clock_settime(clockid_t id, const struct timespec *wanted) {
  struct timespec now;
  if (id != CLOCK_REALTIME || !state) return errno = EPERM, -1;
  real_gettime(id, &now);
  set(whole(&now), whole(wanted) - whole(&now), state->steered);
  return 0;
}

int clock_adjtime(clockid_t id, struct timex *t) {
  struct timespec now;
  if (id != CLOCK_REALTIME || !state) return errno = EPERM, -1;
  real_gettime(id, &now);
  int64_t moved = ahead(whole(&now)), rate = state->steered;
  if (t->modes & ADJ_FREQUENCY) rate = t->freq;
  if (t->modes & ADJ_TICK) rate += (t->tick - 10000) * 100 * 65536; /* a tick of 10,000 us that is 1 us longer: 100 ppm */
  if (t->modes & ADJ_SETOFFSET) moved += t->time.tv_sec * 1000000000LL + t->time.tv_usec * (t->modes & ADJ_NANO ? 1 : 1000);
  if (t->modes & (ADJ_FREQUENCY | ADJ_TICK | ADJ_SETOFFSET)) set(whole(&now), moved, rate);
  t->freq = rate, t->tolerance = 500 * 65536, t->tick = 10000, t->status = 0;
  return TIME_OK;
}

/* Who waits until a time of this clock waits for a moment of the kernel's, and is woken to look again: the clock may have been set
   meanwhile. Times of CLOCK_MONOTONIC are those of a machine that is up for less than 30 years. */
int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until) {
  struct timespec now;
  start();
  if (!state || until->tv_sec < 1000000000) return real_wait(condition, mutex, until);
  real_gettime(CLOCK_REALTIME, &now);
  int64_t left = whole(until) - whole(&now) - ahead(whole(&now)), moment = left < 50000000 ? left : 50000000;
  int64_t then = whole(&now) + (moment > 0 ? moment : 0);
  struct timespec end = {then / 1000000000, then % 1000000000};
  int result = real_wait(condition, mutex, &end);
  return result == ETIMEDOUT && left > moment ? 0 : result;
}

ssize_t recvmsg(int socket, struct msghdr *message, int flags) {
  start();
  ssize_t result = real_recvmsg(socket, message, flags);
  if (result < 0) return result;
  for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c; c = CMSG_NXTHDR(message, c)) {
    if (c->cmsg_level != SOL_SOCKET || (c->cmsg_type != SO_TIMESTAMPING && c->cmsg_type != SO_TIMESTAMPNS)) continue;
    struct timespec stamp;
    memcpy(&stamp, CMSG_DATA(c), sizeof stamp); /* the first of three of SO_TIMESTAMPING is the software's */
    if (stamp.tv_sec || stamp.tv_nsec) move(&stamp);
    memcpy(CMSG_DATA(c), &stamp, sizeof stamp);
  }
  return result;
}
"""


class MovedClock:
    """A clock that is `ahead` of that of this machine and runs fast by `drift`, for the processes that get its `variables`.

    Parameters
    ----------
    folder : Path
        Where library and state are kept; an `AbsentError` says that there is no compiler.
    ahead : float
        By how much it is ahead [s].
    drift : float
        By how much it runs fast [ppm].
    """

    def __init__(self, folder: Path, ahead: float, drift: float = 0.0) -> None:
        if shutil.which("cc") is None:
            raise AbsentError("no C compiler (cc) for the clock of another computer: install gcc or clang")
        source, library, file = (folder / name for name in ("moved.c", "moved.so", "clock"))
        source.write_text(_SOURCE, encoding="utf-8")
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"], check=True)
        file.write_bytes(_STATE.pack(0, time.time_ns(), round(ahead * 1e9), round(drift * _PPM), 0))
        with file.open("r+b") as opened:
            self._state = mmap.mmap(opened.fileno(), _STATE.size)
        self.variables: dict[str, str] = {"LD_PRELOAD": str(library), "HANDWAVE_CLOCK": str(file)}

    def ahead(self) -> float:
        """Tell by how much it is ahead now [s]: the truth."""
        while True:
            turn, since, moved, drift, steered = _STATE.unpack(self._state[:])
            now = time.time_ns()
            if turn % 2 == 0 and _STATE.unpack(self._state[:])[0] == turn:
                return float(moved + (now - since) * (drift + steered) / (_PPM * 1e6)) * 1e-9

    def step(self, seconds: float) -> None:
        """Let it jump by so much; nobody may steer it meanwhile."""
        turn, since, moved, drift, steered = _STATE.unpack(self._state[:])
        self._state[:] = _STATE.pack(turn + 2, since, moved + round(seconds * 1e9), drift, steered)

    @contextlib.contextmanager
    def here(self) -> Iterator[None]:
        """Put its variables into the environment for as long as the block lasts: processes that start meanwhile have this clock."""
        os.environ.update(self.variables)
        try:
            yield
        finally:
            for name in self.variables:
                del os.environ[name]
