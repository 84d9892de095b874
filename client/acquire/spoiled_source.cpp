#include "client/acquire/spoiled_source.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace teletact::client {
namespace {

constexpr double kWrong = 3;
constexpr std::size_t kMaxSaid = 4096;

}  // namespace

SpoiledSource::SpoiledSource(std::unique_ptr<FrameSource> source, const std::string& pipe)
    : source_(std::move(source)), pipe_(::open(pipe.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)) {
  if (!pipe_)
    throw std::runtime_error("--spoil " + pipe + ": " + std::strerror(errno) + "; make it by mkfifo");
}

FramePair SpoiledSource::take(std::size_t window) {
  FramePair pair = source_->take(window);
  std::array<char, 256> buffer{};
  const ssize_t got = ::read(pipe_.get(), buffer.data(), buffer.size());
  if (got > 0 && said_.size() < kMaxSaid) said_.append(buffer.data(), static_cast<std::size_t>(got));
  const std::size_t end = said_.find('\n');
  if (end == std::string::npos) return pair;
  const std::string how = said_.substr(0, end);
  said_.erase(0, end + 1);
  if (how == "force")
    pair.acquisition.mutable_probe_force()->set_force_n(kWrong * pair.acquisition.probe_force().force_n());
  if (how == "decorrelated") std::reverse(pair.post.begin(), pair.post.end());
  return pair;
}

}  // namespace teletact::client
