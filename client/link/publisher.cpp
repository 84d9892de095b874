#include "client/link/publisher.h"

#include <google/protobuf/util/delimited_message_util.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <iterator>
#include <sstream>
#include <utility>

namespace teletact::client {
namespace {

std::shared_ptr<const std::string> delimited(const v1::RecordEntry& entry) {
  std::ostringstream out;
  google::protobuf::util::SerializeDelimitedToOstream(entry, &out);
  return std::make_shared<const std::string>(std::move(out).str());
}

bool left_out(const v1::RecordEntry& entry) {
  return (entry.has_touch_response() && entry.touch_response().has_law()) ||
         (entry.has_estimate_request() && entry.estimate_request().has_chunk()) ||
         (entry.has_estimate_response() && entry.estimate_response().has_map());
}

}  // namespace

Publisher::Publisher(const std::string& path, const v1::RecordHeader& header)
    : path_(path), listening_(listen_at(kFlag, path)), wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  v1::RecordEntry first;
  *first.mutable_header() = header;
  first.mutable_header()->set_version(kRecordingVersion);
  first_.push_back(delimited(first));
  thread_ = std::thread([this] { run(); });
}

Publisher::~Publisher() {
  {
    std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake();
  thread_.join();
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

void Publisher::wake() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = ::write(wake_.get(), &one, sizeof(one));
}

void Publisher::append(v1::RecordEntry entry) {
  if (left_out(entry)) return;
  const bool opens = entry.has_touch_request() && entry.touch_request().has_open();
  const bool opened = entry.has_touch_response() && entry.touch_response().has_opened();
  const Bytes bytes = delimited(entry);
  bool first = false;
  {
    std::lock_guard lock(mutex_);
    if (opens) first_.resize(1);  // a new stream
    if ((opens || opened) && first_.size() < 3) first_.push_back(bytes);
    if (fresh_bytes_ + bytes->size() > kMaxQueuedBytes) {
      ++dropped_;
      return;
    }
    first = fresh_.empty();
    fresh_bytes_ += bytes->size();
    fresh_.push_back(bytes);
  }
  if (first) wake();
}

void Publisher::queue_for(Peer& peer, const Bytes& bytes) {
  if (peer.queued_bytes + bytes->size() > kMaxQueuedBytes) {
    ++dropped_;
    return;
  }
  peer.queued_bytes += bytes->size();
  peer.queue.push_back(bytes);
}

bool Publisher::send(Peer& peer) {
  while (!peer.queue.empty()) {
    const std::string& bytes = *peer.queue.front();
    const ssize_t sent = ::send(peer.file.get(), bytes.data() + peer.sent, bytes.size() - peer.sent,
                                MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0) return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
    peer.sent += static_cast<std::size_t>(sent);
    if (peer.sent < bytes.size()) return true;
    peer.queued_bytes -= bytes.size();
    peer.sent = 0;
    peer.queue.pop_front();
  }
  return true;
}

void Publisher::accept() {
  FileDescriptor file(::accept4(listening_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (!file || peers_.size() >= kMaxPeers) return;  // one too many is closed
  std::lock_guard lock(mutex_);
  peers_.push_back({std::move(file), {}, 0, 0});
  for (const Bytes& bytes : first_) queue_for(peers_.back(), bytes);
}

void Publisher::hand_out(const std::vector<Bytes>& fresh) {
  for (Peer& peer : peers_)
    for (const Bytes& bytes : fresh) queue_for(peer, bytes);
}

// What is left of the session, its last figures among it, to those who read.
void Publisher::say_goodbye() {
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
  for (Peer& peer : peers_)
    while (send(peer) && !peer.queue.empty() && std::chrono::steady_clock::now() < end) {
      pollfd polled{peer.file.get(), POLLOUT, 0};
      ::poll(&polled, 1, 20);
    }
}

void Publisher::run() {
  while (true) {
    std::vector<pollfd> polled{{wake_.get(), POLLIN, 0}, {listening_.get(), POLLIN, 0}};
    for (const Peer& peer : peers_)
      polled.push_back(
          {peer.file.get(), static_cast<short>(peer.queue.empty() ? POLLIN : POLLIN | POLLOUT), 0});
    ::poll(polled.data(), polled.size(), -1);
    std::vector<Bytes> fresh;
    bool stopping = false;
    std::uint64_t woken = 0;
    [[maybe_unused]] const auto read = ::read(wake_.get(), &woken, sizeof(woken));
    {
      std::lock_guard lock(mutex_);
      fresh.swap(fresh_);
      fresh_bytes_ = 0;
      stopping = stopping_;
    }
    hand_out(fresh);
    auto at = polled.begin() + 2;
    for (auto peer = peers_.begin(); peer != peers_.end(); ++at) {
      std::array<char, 4096> said{};  // peers have nothing to say: their end is read, the rest thrown away
      const bool ended = (at->revents & (POLLIN | POLLHUP | POLLERR)) != 0 &&
                         ::recv(peer->file.get(), said.data(), said.size(), MSG_DONTWAIT) <= 0;
      peer = ended || !send(*peer) ? peers_.erase(peer) : std::next(peer);
    }
    if (stopping) return say_goodbye();
    if ((polled[1].revents & POLLIN) != 0) accept();
  }
}

}  // namespace teletact::client
