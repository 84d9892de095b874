#include "client/link/channel.h"

#include <grpcpp/support/client_interceptor.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <chrono>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {
namespace {

constexpr int kFirstBackoffMs = 50;
constexpr int kLargestBackoffMs = 200;
constexpr int kConnectTimeoutMs = 3000;  // shorter, and TCP, TLS and HTTP/2 do not get through a slow link
constexpr int kKeepaliveMs = 30000;      // a second net only: silence on the stream is noticed long before
constexpr double kConnectWaitS = 3;
constexpr int kMaxMessageBytes = 256 << 20;

// Adds the client's name to the metadata of a call as it goes out.
class Naming final : public grpc::experimental::Interceptor {
 public:
  explicit Naming(const std::string& name) : name_(name) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* call) override {
    using grpc::experimental::InterceptionHookPoints;
    if (call->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_INITIAL_METADATA))
      call->GetSendInitialMetadata()->emplace("teletact-client", name_);
    call->Proceed();
  }

 private:
  const std::string& name_;  // the factory's, which the channel keeps
};

class NamingFactory final : public grpc::experimental::ClientInterceptorFactoryInterface {
 public:
  explicit NamingFactory(std::string name) : name_(std::move(name)) {}
  grpc::experimental::Interceptor* CreateClientInterceptor(grpc::experimental::ClientRpcInfo*) override {
    return new Naming(name_);  // gRPC owns it
  }

 private:
  const std::string name_;
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

}  // namespace

const std::string& client_name() {
  static const std::string name = make_client_name();
  return name;
}

grpc::ChannelArguments channel_arguments() {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, kConnectTimeoutMs);  // gRPC's name for it
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kLargestBackoffMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  // gRPC's own retries add nothing to ours, and with them a call whose service drains under it may never end,
  // whatever its deadline (gRPC 1.51).
  arguments.SetInt(GRPC_ARG_ENABLE_RETRIES, 0);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  return arguments;
}

std::shared_ptr<grpc::Channel> make_channel(const std::string& address, const std::string& tls_ca,
                                            const std::string& name) {
  const auto credentials =
      tls_ca.empty() ? grpc::InsecureChannelCredentials() : grpc::SslCredentials({tls_ca, "", ""});
  std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(std::make_unique<NamingFactory>(name));
  return grpc::experimental::CreateCustomChannelWithInterceptors(address, credentials, channel_arguments(),
                                                                 std::move(interceptors));
}

Connecting::Connecting(std::string address, std::string tls_ca)
    : address_(std::move(address)), tls_ca_(std::move(tls_ca)) {}

std::shared_ptr<grpc::Channel> Connecting::wait(double wait_s) {
  const auto now = std::chrono::steady_clock::now();
  // One that was refused tries again by itself, after its backoff.
  const bool hangs = attempts_.empty() || attempts_.back()->GetState(true) == GRPC_CHANNEL_CONNECTING;
  if (hangs && now >= next_attempt_) {
    attempts_.push_back(make_channel(address_, tls_ca_));
    if (attempts_.size() > kMostAttempts) attempts_.pop_front();
    next_attempt_ = now + std::chrono::milliseconds(static_cast<int>(1e3 * kAttemptS));
  }
  wait_connected(*attempts_.back(), wait_s);
  for (const auto& attempt : attempts_)
    if (attempt->GetState(false) == GRPC_CHANNEL_READY) return attempt;
  return nullptr;
}

std::string address_problem(const std::string& address) {
  const auto begins = [&address](const char* with) { return address.rfind(with, 0) == 0; };
  for (const char* scheme : {"unix:", "unix-abstract:", "dns:", "ipv4:", "ipv6:"})
    if (begins(scheme)) return "";
  std::string remedy = "give HOST:PORT or unix:/path, not " + address;
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0 || begins("http")) return remedy;
  unsigned port = 0;
  const char* const end = address.data() + address.size();
  const auto parsed = std::from_chars(address.data() + colon + 1, end, port);
  return parsed.ec == std::errc() && parsed.ptr == end && port > 0 && port <= 65535 ? "" : remedy;
}

std::string read_tls_ca(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (text.find("-----BEGIN CERTIFICATE") == std::string::npos)
    throw std::runtime_error(
        "--tls-ca " + path +
        ": no PEM certificate can be read there; give the one that signed the service's");
  return text;
}

std::string nobody_answers(const std::string& address, const std::string& tls_ca) {
  return "no service at " + address + ": start one with './teletact serve --listen " + address +
         "' (teletact-service), " +
         (tls_ca.empty() ? "or give --tls-ca if it serves TLS"
                         : "with a certificate that --tls-ca signed for that name");
}

std::shared_ptr<grpc::Channel> reach_service(const std::string& address, const std::string& tls_ca,
                                             const std::function<void(const std::string&)>& say) {
  using namespace std::chrono_literals;
  constexpr auto kServesWithin = 60s, kCallDeadline = 5s;
  auto channel = make_channel(address, tls_ca);
  const auto stub = v1::Palpation::NewStub(channel);
  const auto give_up = std::chrono::steady_clock::now() + kServesWithin;
  for (bool said = false;; said = true) {
    if (!wait_connected(*channel, kConnectWaitS)) throw std::runtime_error(nobody_answers(address, tls_ca));
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kCallDeadline);
    v1::ListScenesResponse scenes;
    const grpc::Status status = stub->ListScenes(&context, {}, &scenes);
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
  static constexpr std::array<const char*, 17> kNames = {
      "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
      "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
      "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
      "DATA_LOSS", "UNAUTHENTICATED"};
  const auto code = static_cast<std::size_t>(status.error_code());
  const std::string name = code < kNames.size() ? kNames[code] : "UNKNOWN";
  return status.error_message().empty() ? name : name + ": " + status.error_message();
}

}  // namespace teletact::client
