#include "client/link/channel.h"

#include <array>
#include <chrono>

namespace teletact::client {
namespace {

constexpr int kFirstBackoffMs = 50;
constexpr int kLargestBackoffMs = 200;
constexpr int kKeepaliveMs = 30000;  // a second net only: silence on the stream is noticed long before
constexpr int kMaxMessageBytes = 256 << 20;

}  // namespace

std::shared_ptr<grpc::Channel> make_channel(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kLargestBackoffMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
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
