// What a person types, read so that the end of the process is the end of the input: a read that waits in the
// kernel for a line would keep the force on until one comes.
#pragma once

#include <array>
#include <atomic>
#include <streambuf>

namespace teletact::client {

class EndableInput final : public std::streambuf {
 public:
  // `end` outlives this.
  EndableInput(int descriptor, const std::atomic<bool>& end) : descriptor_(descriptor), end_(end) {}

 protected:
  int_type underflow() override;

 private:
  int descriptor_;
  const std::atomic<bool>& end_;
  std::array<char, 256> text_{};
};

}  // namespace teletact::client
