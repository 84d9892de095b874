#include "service/rpc/connections.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <string_view>
#include <utility>

#include "service/base/paced_log.h"

namespace teletact::service {

namespace {

constexpr std::chrono::milliseconds kLook{20}, kLookAtKnown{200};
constexpr int kNoRoomMs = 5;

// What gRPC calls a peer, and its host alone.
struct Peer {
  std::string name, host;
};

Peer peer_of(const sockaddr_storage& address) {
  char text[INET6_ADDRSTRLEN] = {};
  if (address.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    inet_ntop(AF_INET, &v4.sin_addr, text, sizeof text);
    return {fmt::format("ipv4:{}:{}", text, ntohs(v4.sin_port)), text};
  }
  const auto& v6 = reinterpret_cast<const sockaddr_in6&>(address);
  if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) {
    inet_ntop(AF_INET, &v6.sin6_addr.s6_addr[12], text, sizeof text);
    return {fmt::format("ipv4:{}:{}", text, ntohs(v6.sin6_port)), text};
  }
  inet_ntop(AF_INET6, &v6.sin6_addr, text, sizeof text);
  return {fmt::format("ipv6:%5B{}%5D:{}", text, ntohs(v6.sin6_port)), text};
}

tcp_info info_of(int socket) {
  tcp_info info{};
  socklen_t size = sizeof info;
  getsockopt(socket, IPPROTO_TCP, TCP_INFO, &info, &size);
  return info;
}

// Of those that nobody has accepted yet.
std::size_t waiting_at(int listener) {
  return info_of(listener).tcpi_unacked;
}

// A size that is set stays as it is, so that the kernel is told that it may change it again.
void set_window(int socket, int bytes, bool stays) {
  ::setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
  constexpr int kKernels = 0;
  if (!stays) ::setsockopt(socket, SOL_SOCKET, SO_BUF_LOCK, &kKernels, sizeof kKernels);
}

void say_cut(const std::string& peer, bool known, const char* why) {
  static PacedLog cuts{"connection_cut"};
  cuts.tell(PacedLog::Clock::now(),
            [&] { return fmt::format("peer={} known={} why=\"{}\"", peer, known, why); });
}

}  // namespace

CountedConnection::CountedConnection(FileDescriptor socket, std::string peer, std::string host,
                                     const ConnectionLimits& limits)
    : socket_(std::move(socket)),
      peer_(std::move(peer)),
      host_(std::move(host)),
      max_open_(limits.max_open),
      may_waste_(limits.wasted) {
  socklen_t size = sizeof usual_window_bytes_;
  ::getsockopt(socket_.get(), SOL_SOCKET, SO_RCVBUF, &usual_window_bytes_, &size);
  usual_window_bytes_ /= 2;  // the kernel doubles what it is given
  set_window(socket_.get(), limits.unknown_window_bytes, true);
}

void CountedConnection::vouch(std::shared_ptr<const void> kept) {
  if (vouched_.exchange(true)) return;
  kept_ = std::move(kept);
  set_window(socket_.get(), usual_window_bytes_, false);
}

void CountedConnection::begun() {
  if (++open_ > max_open_) cut("calls that are reset and pile up");
}

void CountedConnection::wasted() {
  {
    const std::lock_guard lock(mutex_);
    if (may_waste_.take(Clock::now())) return;
  }
  cut("calls that come to nothing");
}

void CountedConnection::cut(const char* why) {
  if (cut_.exchange(true)) return;
  // Whoever still sends is told at once.
  const linger none{1, 0};
  setsockopt(socket_.get(), SOL_SOCKET, SO_LINGER, &none, sizeof none);
  ::shutdown(socket_.get(), SHUT_RDWR);
  // gRPC would read on what has arrived.
  constexpr std::size_t kBytes = 1 << 20;
  for (int k = 0; k < 64 && ::recv(socket_.get(), nullptr, kBytes, MSG_TRUNC | MSG_DONTWAIT) > 0; ++k)
    continue;
  say_cut(peer_, vouched(), why);
}

std::uint64_t CountedConnection::received_bytes() const {
  return info_of(socket_.get()).tcpi_bytes_received;
}

CountedConnection::Seen CountedConnection::look(Clock::time_point now) {
  constexpr int kEstablished = 1, kSynReceived = 3, kPeerHasClosed = 8;
  const tcp_info info = info_of(socket_.get());
  const int state = info.tcpi_state;
  const std::uint64_t received = info.tcpi_bytes_received;
  int unread = 0;
  ::ioctl(socket_.get(), FIONREAD, &unread);
  const std::uint64_t read = received - static_cast<std::uint64_t>(unread);
  if (unread > 0 && read == read_bytes_) late_at_ = now;
  read_bytes_ = read;
  return {state != kEstablished && state != kSynReceived && state != kPeerHasClosed, received,
          received - std::exchange(received_bytes_, received)};
}

void Connections::begin(std::vector<FileDescriptor> listeners, Hand hand, std::size_t largest_message_bytes) {
  listeners_ = std::move(listeners);
  hand_ = std::move(hand);
  max_unknown_bytes_ = 2 * largest_message_bytes;
  woken_ = FileDescriptor(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  thread_ = std::thread([this] { serve(); });
}

void Connections::end() {
  if (!thread_.joinable()) return;
  stop_ = true;
  eventfd_write(woken_.get(), 1);
  thread_.join();
  listeners_.clear();
}

std::shared_ptr<CountedConnection> Connections::of(const std::string& peer) const {
  const std::lock_guard lock(mutex_);
  const auto found = by_peer_.find(peer);
  return found == by_peer_.end() ? nullptr : found->second;
}

std::size_t Connections::count() const {
  const std::lock_guard lock(mutex_);
  return by_peer_.size();
}

void Connections::call_came(Identity identity) {
  const auto now = Clock::now();
  const std::lock_guard lock(mutex_);
  if (vouched_.contains(identity) || unknown_calls_.take(now)) return;
  cut_unknown(now, "calls of all that have not shown who they are");
}

void Connections::vouch(CountedConnection& connection, Identity identity, std::shared_ptr<const void> kept) {
  const std::lock_guard lock(mutex_);
  connection.vouch(std::move(kept));
  vouched_.insert_or_assign(identity, connection.peer());
}

// Under the mutex. Whoever reads the calls of one does so here, and reads the rest of no other.
void Connections::cut_unknown(Clock::time_point now, const char* why) {
  constexpr std::chrono::milliseconds kBetween{2};
  if (now - flooded_ < kBetween) return;
  flooded_ = now;
  for (const auto& [peer, connection] : by_peer_)
    if (!connection->vouched() && connection->received_bytes() > limits_.first_call_bytes)
      connection->cut(why);
}

void Connections::serve() {
  std::vector<pollfd> waiting{{woken_.get(), POLLIN, 0}};
  for (const FileDescriptor& listener : listeners_) waiting.push_back({listener.get(), POLLIN, 0});
  Clock::time_point next_look{};
  while (!stop_) {
    const bool room = make_room(Clock::now());
    const int patience = count() == 0 ? -1 : static_cast<int>((unknown_ > 0 ? kLook : kLookAtKnown).count());
    const int ready = ::poll(waiting.data(), room ? waiting.size() : 1, room ? patience : kNoRoomMs);
    const auto now = Clock::now();
    if (now >= next_look) {
      look(now);
      next_look = now + kLook;
    }
    if (ready <= 0 || !room) continue;
    for (std::size_t k = 1; k < waiting.size(); ++k)
      if (waiting[k].revents != 0) accept(waiting[k].fd, now);
  }
}

void Connections::look(Clock::time_point now) {
  const std::size_t resident_bytes = unknown_ > 0 ? resident_bytes_now() : 0;
  std::uint64_t newly_received = 0;
  const std::lock_guard lock(mutex_);
  for (auto at = by_peer_.begin(); at != by_peer_.end();) {
    CountedConnection& connection = *at->second;
    const auto seen = connection.look(now);
    const double age_s = std::chrono::duration<double>(now - connection.since()).count();
    const bool grown = resident_bytes > connection.resident_bytes_then() + limits_.growth_bytes;
    const double at_once = grown ? limits_.unknown_bytes_per_second : static_cast<double>(max_unknown_bytes_);
    const double max_bytes = at_once + limits_.unknown_bytes_per_second * age_s;
    if (!connection.vouched()) newly_received += seen.since_last_look;
    if (!connection.vouched() && static_cast<double>(seen.received_bytes) > max_bytes)
      connection.cut("bytes before it has shown who it is");
    if (connection.was_cut())
      after_cut_.try_emplace(connection.host(), now, limits_.after_cut).first->second.until =
          now + limits_.after_cut_for;
    if (connection.was_cut() || seen.closed) {
      std::erase_if(vouched_, [&](const auto& of) { return of.second == at->first; });
      at = by_peer_.erase(at);
    } else {
      ++at;
    }
  }
  if (!unknown_bytes_.take(now, static_cast<double>(newly_received)))
    cut_unknown(now, "bytes of all that have not shown who they are");
  std::erase_if(after_cut_, [&](const auto& host) { return host.second.until < now; });
}

// Who waits behind more than there are places for waits less for each of them.
Connections::Clock::duration Connections::patience() const {
  std::size_t waiting = 0;
  for (const FileDescriptor& listener : listeners_) waiting += waiting_at(listener.get());
  const double places = static_cast<double>(limits_.max_unknown);
  const double share = places / (places + static_cast<double>(waiting));
  const std::chrono::duration<double, std::milli> each = share * share * limits_.min_for_showing;
  return std::max(std::chrono::duration_cast<Clock::duration>(each),
                  std::min<Clock::duration>(limits_.min_for_showing, limits_.min_while_many_wait));
}

// The place of one who has had its time, where none is left: the oldest of the host that has most.
bool Connections::make_room(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  unknown_ = 0;
  struct OfHost {
    std::size_t count = 0;
    CountedConnection* oldest = nullptr;
  };
  std::map<std::string_view, OfHost> hosts;
  for (const auto& [peer, connection] : by_peer_) {
    if (connection->vouched()) continue;
    ++unknown_;
    OfHost& host = hosts[connection->host()];
    ++host.count;
    if (!host.oldest || connection->since() < host.oldest->since()) host.oldest = connection.get();
  }
  if (now - flooded_ < limits_.none_after_flood) return false;
  if (unknown_ < limits_.max_unknown && by_peer_.size() < limits_.max) return true;
  const auto most = std::max_element(hosts.begin(), hosts.end(), [](const auto& a, const auto& b) {
    return std::pair(a.second.count, b.second.oldest->since()) <
           std::pair(b.second.count, a.second.oldest->since());
  });
  if (most == hosts.end() || now - most->second.oldest->since() < patience()) return false;
  CountedConnection& oldest = *most->second.oldest;
  oldest.cut("others wait, and it has not shown who it is");
  by_peer_.erase(std::string(oldest.peer()));
  return true;
}

void Connections::accept(int listener, Clock::time_point now) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  FileDescriptor socket(
      ::accept4(listener, reinterpret_cast<sockaddr*>(&address), &size, SOCK_CLOEXEC | SOCK_NONBLOCK));
  FileDescriptor ours(socket ? ::fcntl(socket.get(), F_DUPFD_CLOEXEC, 0) : -1);
  if (!ours) {
    if (errno == EMFILE || errno == ENFILE) std::this_thread::sleep_for(kLook);
    return;
  }
  const Peer peer = peer_of(address);
  if (!welcome(peer.host, now)) return;
  {
    const std::lock_guard lock(mutex_);
    by_peer_.insert_or_assign(
        peer.name, std::make_shared<CountedConnection>(std::move(ours), peer.name, peer.host, limits_));
  }
  hand_(socket.release(), listener);
}

bool Connections::welcome(const std::string& host, Clock::time_point now) {
  const auto found = after_cut_.find(host);
  return found == after_cut_.end() || found->second.allowance.take(now);
}

}  // namespace teletact::service
