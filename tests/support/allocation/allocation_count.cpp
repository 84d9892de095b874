#include "tests/support/allocation/allocation_count.h"

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

// Plain thread-local storage of the program itself: touching it allocates nothing.
thread_local bool counting = false;
thread_local std::size_t allocations = 0;

std::atomic<std::size_t> refused{0};

// Whether there is room.
bool note(std::size_t bytes) noexcept {
  if (counting) ++allocations;
  return bytes == 0 || bytes != refused.load(std::memory_order_relaxed);
}

}  // namespace

namespace teletact::test {

void count_allocations(bool on) noexcept {
  if (on) allocations = 0;
  counting = on;
}

std::size_t counted_allocations() noexcept {
  return allocations;
}

NoRoomFor::NoRoomFor(std::size_t bytes) noexcept {
  refused = bytes;
}

NoRoomFor::~NoRoomFor() {
  refused = 0;
}

}  // namespace teletact::test

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)

void* operator new(std::size_t bytes) {
  if (void* memory = note(bytes) ? std::malloc(bytes) : nullptr) return memory;
  throw std::bad_alloc();
}
// What std::stable_sort asks for; without it the sanitizer's own would meet our delete.
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return note(bytes) ? std::malloc(bytes) : nullptr;
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

#else

// glibc's own, by the names that it exports for programs that do this.
extern "C" {
void* __libc_malloc(std::size_t bytes);
void* __libc_calloc(std::size_t count, std::size_t bytes);
void* __libc_realloc(void* memory, std::size_t bytes);
void* __libc_memalign(std::size_t alignment, std::size_t bytes);

void* malloc(std::size_t bytes) {
  return note(bytes) ? __libc_malloc(bytes) : nullptr;
}
void* calloc(std::size_t count, std::size_t bytes) {
  note(0);
  return __libc_calloc(count, bytes);
}
void* realloc(void* memory, std::size_t bytes) {
  note(0);
  return __libc_realloc(memory, bytes);
}
void* memalign(std::size_t alignment, std::size_t bytes) {
  note(0);
  return __libc_memalign(alignment, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  note(0);
  return __libc_memalign(alignment, bytes);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t bytes) {
  note(0);
  *memory = __libc_memalign(alignment, bytes);
  return *memory == nullptr ? 12 : 0;  // ENOMEM
}
}

#endif
