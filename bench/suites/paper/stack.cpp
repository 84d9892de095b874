#include "bench/suites/paper/stack.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "bench/suite.h"

namespace teletact::bench {
namespace {

[[noreturn]] void fail(const char* what) {
  throw BenchError(std::string(what) + " on the loopback interface: " + std::strerror(errno));
}

bool send_all(int socket, const double* values, std::size_t count) {
  const char* bytes = reinterpret_cast<const char*>(values);
  for (std::size_t left = count * sizeof(double); left > 0;) {
    const ssize_t sent = send(socket, bytes, left, MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes += sent;
    left -= static_cast<std::size_t>(sent);
  }
  return true;
}

bool receive_all(int socket, double* values, std::size_t count) {
  return recv(socket, values, count * sizeof(double), MSG_WAITALL) ==
         static_cast<ssize_t>(count * sizeof(double));
}

void send_at_once(int socket) {
  const int on = 1;
  setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
}

}  // namespace

PaperStack::PaperStack(Peer& solver, const ContactProblem& problem) : solver_(solver), problem_(problem) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* where = reinterpret_cast<sockaddr*>(&address);
  socklen_t size = sizeof(address);
  listening_ = socket(AF_INET, SOCK_STREAM, 0);
  near_ = socket(AF_INET, SOCK_STREAM, 0);
  if (listening_ < 0 || near_ < 0 || bind(listening_, where, size) != 0 || listen(listening_, 1) != 0 ||
      getsockname(listening_, where, &size) != 0 || connect(near_, where, size) != 0)
    fail("no TCP connection");
  far_ = accept(listening_, nullptr, nullptr);
  if (far_ < 0) fail("no TCP connection");
  send_at_once(near_);
  send_at_once(far_);
  server_ = std::thread([this] { serve(); });
}

PaperStack::~PaperStack() {
  shutdown(near_, SHUT_RDWR);
  if (server_.joinable()) server_.join();
  for (const int socket : {near_, far_, listening_}) close(socket);
}

// Linear in the displacement: solved for the problem's own and scaled, which costs what any displacement
// would.
void PaperStack::serve() {
  double indentation_m = 0;
  while (receive_all(far_, &indentation_m, 1)) {
    const PeerAnswer answer = solver_.touch(problem_, 0);
    const double scale = indentation_m / problem_.pose.indentation_m;
    std::vector<double> out{scale * answer.force_n[0], scale * answer.force_n[1]};
    for (const double displacement_m : answer.displacement_m) out.push_back(scale * displacement_m);
    if (!send_all(far_, out.data(), out.size())) return;
  }
}

std::vector<double> PaperStack::touch(double indentation_m) {
  std::vector<double> solution(2 + problem_.tissue.grid.dofs());
  if (!send_all(near_, &indentation_m, 1) || !receive_all(near_, solution.data(), solution.size()))
    fail("the TCP connection broke");
  return solution;
}

}  // namespace teletact::bench
