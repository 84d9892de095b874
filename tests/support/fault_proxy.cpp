#include "tests/support/fault_proxy.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>

namespace teletact::test {
namespace {

std::int64_t now() {
  return std::chrono::steady_clock::now().time_since_epoch().count();
}

std::int64_t to_ns(double seconds) {
  return static_cast<std::int64_t>(seconds * 1e9);
}

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error("fault proxy: " + what + ": " + std::strerror(errno));
}

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  return address;
}

// A non-blocking socket connected to `target`; -1 when nobody listens there.
int connect_to(const std::string& target) {
  int socket_fd = -1, result = -1;
  if (target.rfind("unix:", 0) == 0) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    target.copy(address.sun_path, sizeof address.sun_path - 1, 5);
    socket_fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    result = connect(socket_fd, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  } else {
    const sockaddr_in address = loopback(std::stoi(target.substr(target.rfind(':') + 1)));
    socket_fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    result = connect(socket_fd, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  }
  if (result != 0) {
    close(socket_fd);
    return -1;
  }
  fcntl(socket_fd, F_SETFL, O_NONBLOCK);
  return socket_fd;
}

void send_at_once(int socket_fd) {
  const int on = 1;
  setsockopt(socket_fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);  // fails on a Unix socket: needs none
}

}  // namespace

FaultProxy::FaultProxy(std::string target, std::uint64_t seed) : target_(std::move(target)), random_(seed) {
  listening_ = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  if (bind(listening_, reinterpret_cast<const sockaddr*>(&address), size) != 0) fail("bind");
  if (listen(listening_, 64) != 0) fail("listen");
  getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size);
  address_ = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  thread_ = std::thread([this] { run(); });
}

FaultProxy::~FaultProxy() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake();
  thread_.join();
  for (Connection& connection : connections_) close_connection(connection, true);
  close(listening_);
  close(wake_);
}

void FaultProxy::wake() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = write(wake_, &one, sizeof one);
}

void FaultProxy::play(std::vector<FaultEvent> schedule) {
  {
    const std::lock_guard lock(mutex_);
    std::stable_sort(schedule.begin(), schedule.end(),
                     [](const FaultEvent& a, const FaultEvent& b) { return a.at_s < b.at_s; });
    schedule_.assign(schedule.begin(), schedule.end());
    schedule_begin_ns_ = now();
  }
  wake();
}

void FaultProxy::play(FaultEvent event) {
  {
    const std::lock_guard lock(mutex_);
    apply(event, now());
  }
  wake();
}

std::uint64_t FaultProxy::connections() const {
  const std::lock_guard lock(mutex_);
  return accepted_;
}
std::uint64_t FaultProxy::bytes_up() const {
  const std::lock_guard lock(mutex_);
  return bytes_up_;
}
std::uint64_t FaultProxy::bytes_down() const {
  const std::lock_guard lock(mutex_);
  return bytes_down_;
}

void FaultProxy::apply(const FaultEvent& event, std::int64_t now_ns) {
  const std::int64_t until_ns = now_ns + to_ns(event.seconds);
  switch (event.kind) {
    case FaultEvent::Kind::kFaults:
      faults_ = event.faults;
      return;
    case FaultEvent::Kind::kStall:
      stalled_until_ns_ = until_ns;
      return;
    case FaultEvent::Kind::kHold:
      for (Connection& connection : connections_) connection.held_until_ns = until_ns;
      return;
    case FaultEvent::Kind::kHalfOpen:
      for (Connection& connection : connections_) connection.held_until_ns = kNever;
      return;
    case FaultEvent::Kind::kReset:
      for (Connection& connection : connections_) close_connection(connection, true);
      connections_.clear();
      return;
  }
}

// Plays what is due; when the next event is.
std::int64_t FaultProxy::play_due_events(std::int64_t now_ns) {
  while (!schedule_.empty()) {
    const std::int64_t due_ns = schedule_begin_ns_ + to_ns(schedule_.front().at_s);
    if (due_ns > now_ns) return due_ns;
    apply(schedule_.front(), now_ns);
    schedule_.pop_front();
  }
  return kNever;
}

void FaultProxy::accept_one() {
  const int client = accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (client < 0) return;
  ++accepted_;
  Connection connection;
  connection.client = client;
  connection.carried_ns = now();
  connection.service = connect_to(target_);
  if (connection.service < 0) {
    close_connection(connection, true);
    return;
  }
  send_at_once(connection.client);
  send_at_once(connection.service);
  connection.up.from = connection.down.to = connection.client;
  connection.up.to = connection.down.from = connection.service;
  connections_.push_back(std::move(connection));
}

void FaultProxy::close_connection(Connection& connection, bool reset) {
  const linger at_once{.l_onoff = 1, .l_linger = 0};
  for (const int socket_fd : {connection.client, connection.service}) {
    if (socket_fd < 0) continue;
    if (reset) setsockopt(socket_fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    close(socket_fd);
  }
}

std::size_t FaultProxy::Pipe::queued_bytes(std::int64_t now_ns) const {
  std::size_t bytes = 0;
  for (const Chunk& chunk : chunks)
    if (chunk.wired_ns > now_ns || chunk.due_ns <= now_ns) bytes += chunk.bytes.size() - chunk.sent;
  return bytes;
}

// A chunk that arrives now: never delivered before the one ahead of it.
void FaultProxy::put_on_wire(const DirectionFaults& faults, Pipe& pipe, Chunk chunk, std::int64_t now_ns) {
  std::uniform_real_distribution<double> share(0, 1);
  double wait_s = faults.delay_s + faults.jitter_s * share(random_);
  if (share(random_) < faults.loss_share) wait_s += faults.retransmission_s;
  chunk.wired_ns = now_ns;
  if (faults.bandwidth_bytes_s > 0)
    chunk.wired_ns = std::max(now_ns, pipe.last_wired_ns) +
                     to_ns(static_cast<double>(chunk.bytes.size()) / faults.bandwidth_bytes_s);
  chunk.due_ns = std::max(chunk.wired_ns + to_ns(wait_s), pipe.last_due_ns);
  pipe.last_wired_ns = chunk.wired_ns;
  pipe.last_due_ns = chunk.due_ns;
  pipe.chunks.push_back(std::move(chunk));
}

void FaultProxy::read_some(Pipe& pipe, const DirectionFaults& faults, std::int64_t now_ns,
                           Connection& connection) {
  // A wire takes packets: what is sent of a long message arrives while the rest is being sent.
  constexpr std::size_t kPacketBytes = 1448;
  std::array<char, 16384> buffer;
  const ssize_t count =
      read(pipe.from, buffer.data(), faults.bandwidth_bytes_s > 0 ? kPacketBytes : buffer.size());
  if (count < 0) {
    connection.failed = errno != EAGAIN && errno != EINTR;
    return;
  }
  if (count == 0) {
    pipe.read_ended = true;
    return;
  }
  connection.carried_ns = now_ns;
  Chunk chunk;
  chunk.bytes.assign(buffer.begin(), buffer.begin() + count);
  put_on_wire(faults, pipe, std::move(chunk), now_ns);
}

// Writes what is due; when there is more to do.
std::int64_t FaultProxy::deliver(Pipe& pipe, std::int64_t now_ns, Connection& connection,
                                 std::uint64_t& delivered) {
  const std::int64_t free_ns = std::max(stalled_until_ns_, connection.held_until_ns);
  if (free_ns > now_ns) return pipe.chunks.empty() && !pipe.read_ended ? kNever : free_ns;
  pipe.blocked = false;
  while (!pipe.chunks.empty() && pipe.chunks.front().due_ns <= now_ns) {
    Chunk& chunk = pipe.chunks.front();
    const ssize_t count =
        send(pipe.to, chunk.bytes.data() + chunk.sent, chunk.bytes.size() - chunk.sent, MSG_NOSIGNAL);
    if (count < 0) {
      pipe.blocked = errno == EAGAIN;
      connection.failed = connection.failed || !pipe.blocked;
      return kNever;  // poll says when
    }
    chunk.sent += static_cast<std::size_t>(count);
    delivered += static_cast<std::uint64_t>(count);
    if (chunk.sent == chunk.bytes.size()) pipe.chunks.pop_front();
  }
  if (!pipe.chunks.empty()) return pipe.chunks.front().due_ns;
  if (pipe.read_ended && !pipe.write_ended) {
    shutdown(pipe.to, SHUT_WR);
    pipe.write_ended = true;
  }
  return kNever;
}

std::vector<pollfd> FaultProxy::polls(std::int64_t now_ns) const {
  std::vector<pollfd> polls{{wake_, POLLIN, 0}, {listening_, POLLIN, 0}};
  const auto events = [now_ns](const Pipe& in, const Pipe& out) {
    const bool read = !in.read_ended && in.queued_bytes(now_ns) < kMaxQueuedBytes;
    return static_cast<short>((read ? POLLIN : 0) | (out.blocked ? POLLOUT : 0));
  };
  for (const Connection& connection : connections_) {
    // A socket that is waited for nothing is left out: poll would report its hang-up again and again.
    const short client = connection.failed ? 0 : events(connection.up, connection.down);
    const short service = connection.failed ? 0 : events(connection.down, connection.up);
    polls.push_back({client != 0 ? connection.client : -1, client, 0});
    polls.push_back({service != 0 ? connection.service : -1, service, 0});
  }
  return polls;
}

// When it will have been idle for too long; at once, and failed, when it has.
std::int64_t FaultProxy::drop_if_idle(Connection& connection, std::int64_t now_ns) const {
  if (faults_.idle_s <= 0) return kNever;
  const std::int64_t end_ns = connection.carried_ns + to_ns(faults_.idle_s);
  connection.failed = connection.failed || now_ns >= end_ns;
  return end_ns;
}

// Reads and delivers on every connection; when there is more to do.
std::int64_t FaultProxy::move_bytes(const std::vector<pollfd>& polled, std::int64_t now_ns) {
  std::int64_t next_ns = kNever;
  std::size_t index = 2;
  for (auto it = connections_.begin(); it != connections_.end(); index += 2) {
    Connection& connection = *it;
    constexpr short kReadable = POLLIN | POLLHUP | POLLERR;
    if (index + 1 < polled.size()) {
      if (polled[index].revents & kReadable) read_some(connection.up, faults_.up, now_ns, connection);
      if (polled[index + 1].revents & kReadable) read_some(connection.down, faults_.down, now_ns, connection);
    }
    next_ns = std::min(next_ns, deliver(connection.up, now_ns, connection, bytes_up_));
    next_ns = std::min(next_ns, deliver(connection.down, now_ns, connection, bytes_down_));
    next_ns = std::min(next_ns, drop_if_idle(connection, now_ns));
    const bool silent = std::max(stalled_until_ns_, connection.held_until_ns) > now_ns;
    const bool over = connection.failed || (connection.up.write_ended && connection.down.write_ended);
    if (over && !silent) {
      close_connection(connection, connection.failed);
      it = connections_.erase(it);
    } else {
      ++it;
    }
  }
  return next_ns;
}

void FaultProxy::run() {
  std::unique_lock lock(mutex_);
  std::int64_t next_ns = 0;
  while (!stopping_) {
    next_ns = std::min(next_ns, play_due_events(now()));
    std::vector<pollfd> polled = polls(now());
    const std::int64_t wait_ns = std::clamp<std::int64_t>(next_ns - now(), 0, 1'000'000'000);
    const timespec wait{.tv_sec = wait_ns / 1'000'000'000, .tv_nsec = wait_ns % 1'000'000'000};
    lock.unlock();
    ppoll(polled.data(), polled.size(), &wait, nullptr);
    std::uint64_t ignored = 0;
    [[maybe_unused]] const auto woken = read(wake_, &ignored, sizeof ignored);
    lock.lock();
    // A reset by play() has taken the polled connections away.
    if (polled.size() != 2 + 2 * connections_.size()) polled.resize(2);
    next_ns = move_bytes(polled, now());
    if (polled[1].revents & POLLIN) accept_one();
  }
}

}  // namespace teletact::test
