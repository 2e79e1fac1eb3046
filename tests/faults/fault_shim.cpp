// SPDX-License-Identifier: MIT
// Loaded before the program's libraries (LD_PRELOAD): lets the N-th of some operations fail, or
// kills the program at it. Only tests use it; faults.py drives it through the environment:
//
//   TARSIER_FAULT=OPERATION:N:ACTION  N counts from 1 and from the start of main()
//     OPERATION  malloc  memory of at least TARSIER_FAULT_LEAST bytes (default 1), by any thread
//                open    a file opened for writing        write  bytes written, also a file's
//                length changed sync    fsync, fdatasync                 rename, mkdir
//     ACTION     ENOSPC EIO EROFS ENOMEM ..  it fails with this, once; with + behind it all later
//     ones, too
//                KILL                        SIGKILL just before it
//                TEAR                        (write) half of the bytes are written, then SIGKILL
//   TARSIER_FAULT_UNDER=FOLDER   files elsewhere are left alone (default: all)
//   TARSIER_FAULT_COUNTS=FILE    where main() ends, how many there were of each is written here
//
// With ENOSPC, the first write that fails has half of its bytes written, as a disk that gets full
// does it.
#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

extern "C" {
void* __libc_malloc(size_t);
void* __libc_calloc(size_t, size_t);
void* __libc_realloc(void*, size_t);
void* __libc_memalign(size_t, size_t);
}

namespace {

enum Operation { kMalloc, kOpen, kWrite, kSync, kRename, kMkdir, kOperations };
constexpr const char* kNames[kOperations] = {"malloc", "open", "write", "sync", "rename", "mkdir"};

struct ErrorName {
  const char* name;
  int number;
};
constexpr ErrorName kErrors[] = {{"ENOSPC", ENOSPC}, {"EIO", EIO},       {"EROFS", EROFS},
                                 {"ENOMEM", ENOMEM}, {"EDQUOT", EDQUOT}, {"EACCES", EACCES}};

// Plain data, set before main(): malloc() may be called before any constructor has run.
bool is_active = false;
int faulty_operation = -1;
long faulty_number = 0;
int faulty_error = 0;  // 0: kill
bool is_permanent = false;
bool kills_mid_write = false;
std::size_t min_bytes = 1;
char under[PATH_MAX] = "";
std::atomic<long> counts[kOperations];

template <typename Function>
Function* real_function(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

void kill_process() {
  ::kill(::getpid(), SIGKILL);
  while (true) ::pause();
}

// What happens at this operation: nothing, or an error number (or it does not return).
enum class Outcome { kSucceed, kFail, kTruncate };
Outcome next_outcome(Operation operation) {
  if (!is_active) return Outcome::kSucceed;
  const long number = ++counts[operation];
  if (operation != faulty_operation || number < faulty_number) return Outcome::kSucceed;
  if (number > faulty_number && !is_permanent) return Outcome::kSucceed;
  if (kills_mid_write) return Outcome::kTruncate;
  if (faulty_error == 0) kill_process();
  if (operation == kWrite && faulty_error == ENOSPC && number == faulty_number)
    return Outcome::kTruncate;
  return Outcome::kFail;
}

bool is_under(const char* path) {
  if (under[0] == '\0') return true;
  char absolute[PATH_MAX];
  if (path[0] != '/') {
    if (::getcwd(absolute, sizeof absolute) == nullptr) return false;
    const std::size_t used = std::strlen(absolute);
    std::snprintf(absolute + used, sizeof absolute - used, "/%s", path);
    path = absolute;
  }
  return std::strncmp(path, under, std::strlen(under)) == 0;
}

bool is_under(int fd) {
  if (!is_active) return false;
  char link[64];
  char path[PATH_MAX];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t size = ::readlink(link, path, sizeof path - 1);
  if (size <= 0) return false;
  path[size] = '\0';
  return path[0] == '/' && std::strncmp(path, "/dev/", 5) != 0 && is_under(path);
}

// Of open(): whether a third argument was given.
bool has_mode(int flags) { return (flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE; }

bool opens_for_writing(int flags) {
  return (flags & O_ACCMODE) != O_RDONLY || (flags & O_CREAT) != 0;
}

bool fails_now(Operation operation) {
  if (next_outcome(operation) == Outcome::kSucceed) return false;
  errno = faulty_error;
  return true;
}

// `write_some(bytes)` writes that many, or all of what the caller wanted.
template <typename WriteSome>
ssize_t faulty_write(int fd, std::size_t bytes, WriteSome write_some) {
  const Outcome outcome = is_under(fd) ? next_outcome(kWrite) : Outcome::kSucceed;
  if (outcome == Outcome::kSucceed) return write_some(bytes);
  if (outcome == Outcome::kTruncate) {
    const ssize_t written = bytes > 1 ? write_some(bytes / 2) : 0;
    if (kills_mid_write) kill_process();
    if (written > 0) {
      is_permanent = true;  // the disk is full now
      return written;
    }
  }
  errno = faulty_error;
  return -1;
}

bool memory_fails(std::size_t bytes) {
  return is_active && bytes >= min_bytes && fails_now(kMalloc);
}

void read_settings() {
  if (const char* text = std::getenv("TARSIER_FAULT_UNDER")) {
    std::snprintf(under, sizeof under, "%s", text);
  }
  if (const char* text = std::getenv("TARSIER_FAULT_LEAST")) {
    min_bytes = std::strtoul(text, nullptr, 10);
  }
  const char* text = std::getenv("TARSIER_FAULT");
  if (text == nullptr) return;
  char operation[32];
  char action[32];
  if (std::sscanf(text, "%31[a-z]:%ld:%31s", operation, &faulty_number, action) != 3) {
    std::fprintf(stderr, "fault_shim: TARSIER_FAULT=%s\n", text);
    std::_Exit(99);
  }
  for (int i = 0; i < kOperations; ++i) {
    if (std::strcmp(operation, kNames[i]) == 0) faulty_operation = i;
  }
  kills_mid_write = std::strcmp(action, "TEAR") == 0;
  const std::size_t size = std::strlen(action);
  if (size > 0 && action[size - 1] == '+') {
    is_permanent = true;
    action[size - 1] = '\0';
  }
  for (const ErrorName& error : kErrors) {
    if (std::strcmp(action, error.name) == 0) faulty_error = error.number;
  }
  const bool is_known = faulty_error != 0 || kills_mid_write || std::strcmp(action, "KILL") == 0;
  if (faulty_operation < 0 || !is_known) {
    std::fprintf(stderr, "fault_shim: TARSIER_FAULT=%s\n", text);
    std::_Exit(99);
  }
}

void write_counts() {
  const char* path = std::getenv("TARSIER_FAULT_COUNTS");
  if (path == nullptr) return;
  std::FILE* file = real_function<std::FILE*(const char*, const char*)>("fopen")(path, "w");
  if (file == nullptr) return;
  for (int i = 0; i < kOperations; ++i) {
    std::fprintf(file, "%s %ld\n", kNames[i], counts[i].load());
  }
  std::fclose(file);
}

int (*program_main)(int, char**, char**) = nullptr;

int faulty_main(int argc, char** argv, char** environment) {
  read_settings();
  is_active = true;
  const int status = program_main(argc, argv, environment);
  is_active = false;
  write_counts();
  return status;
}

}  // namespace

extern "C" {

int __libc_start_main(int (*main)(int, char**, char**), int argc, char** argv, void (*init)(),
                      void (*fini)(), void (*rtld_fini)(), void* stack_end) {
  program_main = main;
  using Start =
      int(int (*)(int, char**, char**), int, char**, void (*)(), void (*)(), void (*)(), void*);
  return real_function<Start>("__libc_start_main")(faulty_main, argc, argv, init, fini, rtld_fini,
                                                   stack_end);
}

void* malloc(size_t bytes) { return memory_fails(bytes) ? nullptr : __libc_malloc(bytes); }
void* calloc(size_t count, size_t bytes) {
  return memory_fails(count * bytes) ? nullptr : __libc_calloc(count, bytes);
}
void* realloc(void* old, size_t bytes) {
  return bytes > 0 && memory_fails(bytes) ? nullptr : __libc_realloc(old, bytes);
}
void* memalign(size_t alignment, size_t bytes) {
  return memory_fails(bytes) ? nullptr : __libc_memalign(alignment, bytes);
}
void* aligned_alloc(size_t alignment, size_t bytes) {
  return memory_fails(bytes) ? nullptr : __libc_memalign(alignment, bytes);
}
int posix_memalign(void** result, size_t alignment, size_t bytes) {
  if (memory_fails(bytes)) return ENOMEM;
  *result = __libc_memalign(alignment, bytes);
  return *result == nullptr ? ENOMEM : 0;
}

#define TARSIER_OPEN(NAME)                                                                      \
  int NAME(const char* path, int flags, ...) {                                                  \
    mode_t mode = 0;                                                                            \
    if (has_mode(flags)) {                                                                      \
      va_list more;                                                                             \
      va_start(more, flags);                                                                    \
      mode = va_arg(more, mode_t);                                                              \
      va_end(more);                                                                             \
    }                                                                                           \
    if (is_active && opens_for_writing(flags) && is_under(path) && fails_now(kOpen)) return -1; \
    return real_function<int(const char*, int, ...)>(#NAME)(path, flags, mode);                 \
  }
TARSIER_OPEN(open)
TARSIER_OPEN(open64)

#define TARSIER_OPEN_AT(NAME)                                                                   \
  int NAME(int folder, const char* path, int flags, ...) {                                      \
    mode_t mode = 0;                                                                            \
    if (has_mode(flags)) {                                                                      \
      va_list more;                                                                             \
      va_start(more, flags);                                                                    \
      mode = va_arg(more, mode_t);                                                              \
      va_end(more);                                                                             \
    }                                                                                           \
    if (is_active && opens_for_writing(flags) && is_under(path) && fails_now(kOpen)) return -1; \
    return real_function<int(int, const char*, int, ...)>(#NAME)(folder, path, flags, mode);    \
  }
TARSIER_OPEN_AT(openat)
TARSIER_OPEN_AT(openat64)

#define TARSIER_FOPEN(NAME)                                                                \
  std::FILE* NAME(const char* path, const char* mode) {                                    \
    const bool is_for_writing = std::strpbrk(mode, "wa+") != nullptr;                      \
    if (is_active && is_for_writing && is_under(path) && fails_now(kOpen)) return nullptr; \
    return real_function<std::FILE*(const char*, const char*)>(#NAME)(path, mode);         \
  }
TARSIER_FOPEN(fopen)
TARSIER_FOPEN(fopen64)

ssize_t write(int fd, const void* bytes, size_t size) {
  const auto real = real_function<ssize_t(int, const void*, size_t)>("write");
  return faulty_write(fd, size, [&](std::size_t some) { return real(fd, bytes, some); });
}

ssize_t writev(int fd, const iovec* parts, int count) {
  std::size_t size = 0;
  for (int i = 0; i < count; ++i) size += parts[i].iov_len;
  return faulty_write(fd, size, [&](std::size_t some) -> ssize_t {
    if (some == size)
      return real_function<ssize_t(int, const iovec*, int)>("writev")(fd, parts, count);
    const auto real = real_function<ssize_t(int, const void*, size_t)>("write");
    return real(fd, parts[0].iov_base, some < parts[0].iov_len ? some : parts[0].iov_len);
  });
}

#define TARSIER_PWRITE(NAME)                                                                    \
  ssize_t NAME(int fd, const void* bytes, size_t size, off_t at) {                              \
    const auto real = real_function<ssize_t(int, const void*, size_t, off_t)>(#NAME);           \
    return faulty_write(fd, size, [&](std::size_t some) { return real(fd, bytes, some, at); }); \
  }
TARSIER_PWRITE(pwrite)
TARSIER_PWRITE(pwrite64)

#define TARSIER_TRUNCATE(NAME)                              \
  int NAME(int fd, off_t size) noexcept {                   \
    if (is_under(fd) && fails_now(kWrite)) return -1;       \
    return real_function<int(int, off_t)>(#NAME)(fd, size); \
  }
TARSIER_TRUNCATE(ftruncate)
TARSIER_TRUNCATE(ftruncate64)

#define TARSIER_SYNC(NAME)                           \
  int NAME(int fd) {                                 \
    if (is_under(fd) && fails_now(kSync)) return -1; \
    return real_function<int(int)>(#NAME)(fd);       \
  }
TARSIER_SYNC(fsync)
TARSIER_SYNC(fdatasync)

int rename(const char* from, const char* to) noexcept {
  if (is_active && is_under(to) && fails_now(kRename)) return -1;
  return real_function<int(const char*, const char*)>("rename")(from, to);
}

int mkdir(const char* path, mode_t mode) noexcept {
  if (is_active && is_under(path) && fails_now(kMkdir)) return -1;
  return real_function<int(const char*, mode_t)>("mkdir")(path, mode);
}

}  // extern "C"
