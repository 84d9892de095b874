// Counts what a thread takes from the heap, by whatever way: malloc and its kin, operator new, Eigen; and
// says that there is none left. Linking this library replaces the program's malloc by one that counts and
// hands on to glibc's (under a sanitizer, which needs malloc for itself: operator new alone).
#pragma once

#include <cstddef>

namespace teletact::test {

// From now on, or no more, on the calling thread. Starting sets the count to zero.
void count_allocations(bool on) noexcept;
// Of the calling thread while it was counting.
std::size_t counted_allocations() noexcept;

// While it lives there is no memory for blocks of exactly this size, on any thread.
class NoRoomFor {
 public:
  explicit NoRoomFor(std::size_t bytes) noexcept;
  ~NoRoomFor();
  NoRoomFor(const NoRoomFor&) = delete;
  NoRoomFor& operator=(const NoRoomFor&) = delete;
};

}  // namespace teletact::test
