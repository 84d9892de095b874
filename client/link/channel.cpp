#include "client/link/channel.h"

#include <grpc/grpc.h>
#include <grpcpp/support/client_interceptor.h>
#include <netdb.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <chrono>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "client/text/shown.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {
namespace {

constexpr int kFirstBackoffMs = 50;
constexpr int kLargestBackoffMs = 200;
constexpr int kConnectTimeoutMs = 3000;  // shorter, and TCP, TLS and HTTP/2 do not get through a slow link
constexpr int kKeepaliveMs = 30000;      // a second net only: silence on the stream is noticed long before
constexpr int kMaxMessageBytes = 256 << 20;

// What a call says of its client, in its metadata.
struct Said {
  std::string name, authorization;  // the latter empty: nothing
};

// Adds it to a call as it goes out.
class Naming final : public grpc::experimental::Interceptor {
 public:
  explicit Naming(const Said& said) : said_(said) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* call) override {
    using grpc::experimental::InterceptionHookPoints;
    if (call->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      call->GetSendInitialMetadata()->emplace("teletact-client", said_.name);
      if (!said_.authorization.empty())
        call->GetSendInitialMetadata()->emplace("authorization", said_.authorization);
    }
    call->Proceed();
  }

 private:
  const Said& said_;  // the factory's, which the channel keeps
};

class NamingFactory final : public grpc::experimental::ClientInterceptorFactoryInterface {
 public:
  explicit NamingFactory(Said said) : said_(std::move(said)) {}
  grpc::experimental::Interceptor* CreateClientInterceptor(grpc::experimental::ClientRpcInfo*) override {
    return new Naming(said_);  // gRPC owns it
  }

 private:
  const Said said_;
};

std::string make_client_name() {
  constexpr std::size_t kLongestHost = 40;  // the whole has at most 64 bytes (info.proto)
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0 || host[0] == '\0') host = {"unknown"};
  std::string name;
  for (const char* c = host.data(); *c != '\0' && name.size() < kLongestHost; ++c)
    name += *c > ' ' && *c <= '~' ? *c : '-';
  return name + ":" + std::to_string(getpid()) + ":" + std::to_string(std::random_device()());
}

// The name in HOST:PORT that stands for no machine; else empty.
std::string unresolved_host(const std::string& given) {
  const std::string address = grpc_target(given);
  for (const char* scheme : {"unix:", "unix-abstract:", "ipv4:", "ipv6:"})
    if (address.starts_with(scheme)) return "";
  std::string host = address.substr(0, address.rfind(':'));
  host.erase(0, host.find_last_of(":/") + 1);  // of "dns:HOST"
  addrinfo* found = nullptr;
  if (host.empty() || host.find(']') != std::string::npos) return "";
  if (::getaddrinfo(host.c_str(), nullptr, nullptr, &found) != 0) return host;
  ::freeaddrinfo(found);
  return "";
}

}  // namespace

const std::string& client_name() {
  static const std::string name = make_client_name();
  return name;
}

grpc::ChannelArguments channel_arguments(bool proxy) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, kConnectTimeoutMs);  // gRPC's name for it
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kLargestBackoffMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  // gRPC's own retries add nothing to ours, and with them a call whose service drains under it may never end,
  // whatever its deadline (gRPC 1.51).
  arguments.SetInt(GRPC_ARG_ENABLE_RETRIES, 0);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, proxy ? 1 : 0);  // gRPC would take it unasked
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  return arguments;
}

std::string grpc_target(const std::string& address) {
  const std::size_t colon = address.find(':');
  const bool host_and_port = colon != std::string::npos && colon + 1 < address.size() &&
                             address.find_first_not_of("0123456789", colon + 1) == std::string::npos;
  const bool path = address.starts_with("unix:") || address.starts_with("unix-abstract:");
  return host_and_port && !path ? "dns:///" + address : address;
}

std::shared_ptr<grpc::Channel> make_channel(const std::string& address, const Credentials& given,
                                            const std::string& name) {
  require_usable(given, address);
  // gRPC ends with its last object, and may wait 10 s for its own poller then (1.51): it is kept to the end
  // of the process.
  [[maybe_unused]] static const bool kept = (grpc_init(), true);
  const auto credentials = given.tls_ca.empty()
                               ? grpc::InsecureChannelCredentials()
                               : grpc::SslCredentials({given.tls_ca, given.tls_key, given.tls_certificate});
  std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(
      std::make_unique<NamingFactory>(Said{name, given.token.empty() ? "" : "Bearer " + given.token}));
  return grpc::experimental::CreateCustomChannelWithInterceptors(
      grpc_target(address), credentials, channel_arguments(given.proxy), std::move(interceptors));
}

Connecting::Connecting(std::string address, Credentials credentials)
    : address_(std::move(address)), credentials_(std::move(credentials)) {}

std::shared_ptr<grpc::Channel> Connecting::wait(double wait_s) {
  const auto now = std::chrono::steady_clock::now();
  // One that was refused tries again by itself, after its backoff.
  const bool hangs = attempts_.empty() || attempts_.back()->GetState(true) == GRPC_CHANNEL_CONNECTING;
  if (hangs && now >= next_attempt_) {
    attempts_.push_back(make_channel(address_, credentials_));
    if (attempts_.size() > kMaxAttempts) attempts_.pop_front();
    next_attempt_ = now + std::chrono::milliseconds(static_cast<int>(1e3 * kAttemptS));
  }
  wait_connected(*attempts_.back(), wait_s);
  for (const auto& attempt : attempts_)
    if (attempt->GetState(false) == GRPC_CHANNEL_READY) return attempt;
  return nullptr;
}

std::string address_problem(const std::string& address) {
  const auto begins = [&address](const char* with) { return address.rfind(with, 0) == 0; };
  constexpr std::size_t kScheme = sizeof("unix:") - 1, kLongestPath = sizeof(sockaddr_un::sun_path) - 1;
  if (begins("unix:/") && address.size() > kScheme + kLongestPath)
    return "the path has " + std::to_string(address.size() - kScheme) + " bytes, a Unix socket's may have " +
           std::to_string(kLongestPath) + "; choose a shorter one";
  for (const char* scheme : {"unix:", "unix-abstract:", "dns:", "ipv4:", "ipv6:"})
    if (begins(scheme)) return "";
  std::string remedy = "give HOST:PORT or unix:/path, not " + address;
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0 || begins("http")) return remedy;
  if (!begins("[") && address.find(':') < colon)
    return "an IPv6 address stands in brackets: [::1]:50051, not " + address;
  unsigned port = 0;
  const char* const end = address.data() + address.size();
  const auto parsed = std::from_chars(address.data() + colon + 1, end, port);
  return parsed.ec == std::errc() && parsed.ptr == end && port > 0 && port <= 65535 ? "" : remedy;
}

std::string nobody_answers(const std::string& address, const Credentials& given) {
  if (const std::string host = unresolved_host(address); !host.empty())
    return "no service at " + address + ": the name " + host + " does not resolve; check it";
  if (given.proxy)
    return "no service at " + address + " through the proxy of the environment (grpc_proxy, https_proxy or " +
           "http_proxy); check it, or leave --proxy out";
  return "no service at " + address + (given.tls_ca.empty() ? "" : ", or TLS with it failed") +
         ": start one with './teletact serve --listen " + address + "' (teletact-service), " +
         (given.tls_ca.empty()            ? "or give --tls-ca if it serves TLS"
          : given.tls_certificate.empty() ? "with a certificate that --tls-ca signed for that name and that "
                                            "is valid by this machine's clock, or give "
                                            "--tls-certificate and --tls-key if it asks for them"
                                          : "with a certificate that --tls-ca signed for that name and that "
                                            "is valid by this machine's clock, and "
                                            "--tls-client-ca that signed --tls-certificate");
}

std::shared_ptr<grpc::Channel> reach_service(const std::string& address, const Credentials& credentials,
                                             const std::function<void(const std::string&)>& say,
                                             double connect_s) {
  using namespace std::chrono_literals;
  constexpr auto kServesWithin = 60s, kCallDeadline = 5s;
  auto channel = make_channel(address, credentials);
  const auto stub = v1::Palpation::NewStub(channel);
  const auto give_up = std::chrono::steady_clock::now() + kServesWithin;
  for (bool said = false;; said = true) {
    if (!wait_connected(*channel, connect_s)) throw std::runtime_error(nobody_answers(address, credentials));
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kCallDeadline);
    v1::ListScenesResponse scenes;
    const grpc::Status status = stub->ListScenes(&context, {}, &scenes);
    if (status.error_code() == grpc::StatusCode::UNAUTHENTICATED)
      throw std::runtime_error("the service at " + address + " does not let this client in (" +
                               describe(status) + ")");
    if (status.error_code() != grpc::StatusCode::UNAVAILABLE) return channel;
    const std::string why = "the service at " + address + " (" + describe(status) + ")";
    if (std::chrono::steady_clock::now() > give_up)
      throw std::runtime_error("waited a minute for " + why + "; see its log");
    if (!said) say("waiting for " + why);
    std::this_thread::sleep_for(100ms);
  }
}

bool wait_connected(grpc::Channel& channel, double wait_s) {
  return channel.WaitForConnected(std::chrono::system_clock::now() +
                                  std::chrono::microseconds(static_cast<std::int64_t>(wait_s * 1e6)));
}

std::string describe(const grpc::Status& status) {
  constexpr std::size_t kLongest = 1000;
  static constexpr std::array<const char*, 17> kNames = {
      "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
      "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
      "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
      "DATA_LOSS", "UNAUTHENTICATED"};
  const auto code = static_cast<std::size_t>(status.error_code());
  const std::string name = code < kNames.size() ? kNames[code] : "UNKNOWN";
  return status.error_message().empty() ? name : name + ": " + shown(status.error_message(), kLongest);
}

}  // namespace teletact::client
