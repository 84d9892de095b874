#include "service/rpc/server.h"

#include <fmt/format.h>
#include <grpcpp/health_check_service_interface.h>  // that the default one is off
#include <grpcpp/resource_quota.h>
#include <grpcpp/server_builder.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "service/rpc/call_metadata.h"
#include "service/rpc/call_of_connection.h"
#include "service/rpc/open_service.h"
#include "service/rpc/services.h"
#include "service/rpc/tls.h"

namespace teletact::service {

namespace {

constexpr int kMaxCallsPerConnection = 256;                        // more wait in the client
constexpr int kHandshakeMs = 10'000, kIdleConnectionMs = 300'000;  // a connection without calls
// Of a connection at once, first and most: others take turns, and it can be cut.
constexpr int kFirstReadBytes = 2 << 10, kMaxReadBytes = 64 << 10;
constexpr int kKeepaliveTimeMs = 10'000, kKeepaliveTimeoutMs = 5'000;

const char* const kServices[] = {"teletact.v1.Info", "teletact.v1.Elastography", "teletact.v1.Palpation"};

std::uint64_t random_instance() {
  std::random_device device;
  return (static_cast<std::uint64_t>(device()) << 32 | device()) | 1;  // never 0
}

// A chunk, or a modulus map with its nodes, and its envelope.
int max_message_bytes(const Limits& limits) {
  constexpr std::uint64_t kEnvelope = 1 << 20, kPerElement = 2 * sizeof(double);
  return static_cast<int>(kEnvelope +
                          std::max(limits.max_chunk_bytes, kPerElement * limits.max_scene_elements));
}

// A message of a thousandth of its size would be inflated before anything is asked about it.
void refuse_compressed(grpc::ServerBuilder& builder) {
  for (const auto algorithm : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP})
    builder.SetCompressionAlgorithmSupportStatus(algorithm, false);
  builder.AddChannelArgument(GRPC_ARG_ENABLE_PER_MESSAGE_DECOMPRESSION, 0);
}

void set_limits(grpc::ServerBuilder& builder, const Limits& limits) {
  builder.SetMaxReceiveMessageSize(max_message_bytes(limits));
  builder.SetMaxSendMessageSize(-1);  // maps are as large as the frames that were allowed in
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  // gRPC would count those that are too many, and keep a reason for each of one read: a second for forty
  // connections. They count as bytes.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PING_STRIKES, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kMaxCallsPerConnection);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, kIdleConnectionMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, static_cast<int>(kMaxHeaderBytes));
  builder.AddChannelArgument(GRPC_ARG_TCP_READ_CHUNK_SIZE, kFirstReadBytes);
  builder.AddChannelArgument(GRPC_ARG_TCP_MAX_READ_CHUNK_SIZE, kMaxReadBytes);
  refuse_compressed(builder);
  grpc::ResourceQuota quota("teletact");
  quota.SetMaxThreads(static_cast<int>(limits.max_threads));
  builder.SetResourceQuota(quota);
}

}  // namespace

Server::Server(const std::vector<std::shared_ptr<Device>>& devices, const ServerOptions& options) {
  Listening listening = prepare_address(options.listen);
  address_ = listening.address;
  held_ = listening.held;
  credentials_ = credentials_of(options.listen);
  core_ =
      std::make_unique<Core>(devices, random_instance(), options, [this](bool work) { tell_devices(work); });
  for (const auto make : {elastography_service, info_service, palpation_service})
    services_.push_back(make(*core_));
  health_ = std::make_unique<HealthService>();
  unknown_ = std::make_unique<UnknownMethods>(core_->connections);
  grpc::EnableDefaultHealthCheckService(false);
  grpc::ServerBuilder builder;
  set_limits(builder, core_->limits);
  if (!listening.sockets.empty()) count_headers(*credentials_, core_->connections);
  if (listening.sockets.empty())
    builder.AddListeningPort(address_, credentials_);
  else
    acceptor_ = builder.experimental().AddExternalConnectionAcceptor(
        grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD, credentials_);
  for (const auto& service : services_) builder.RegisterService(service.get());
  builder.RegisterService(health_.get());
  builder.RegisterCallbackGenericService(unknown_.get());
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(std::make_unique<CountCalls>(core_->connections));
  builder.experimental().SetInterceptorCreators(std::move(interceptors));
  server_ = builder.BuildAndStart();
  if (!server_)
    throw std::runtime_error(fmt::format("--listen {}: cannot listen there", options.listen.listen));
  set_health(false);
  if (!acceptor_) return;
  core_->connections.begin(
      std::move(listening.sockets),
      [this](int socket, int listener) {
        grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters taken;
        taken.listener_fd = listener;
        taken.fd = socket;
        acceptor_->HandleNewConnection(&taken);
      },
      static_cast<std::size_t>(max_message_bytes(core_->limits)));
}

Server::~Server() {
  drain();
}

void Server::set_health(bool serving) {
  for (const char* name : kServices) health_->set(name, serving);
  health_->set("", serving);
}

// Touch goes on without them, by compliances.
void Server::tell_devices(bool work) {
  health_->set("teletact.v1.Elastography", work);
}

void Server::make_ready() {
  core_->imaging.warm();
  core_->scenes.restore();
  core_->calls.open();
  set_health(true);
}

void Server::leave() {
  spdlog::info("event=leave calls={}", core_->calls.count());
  core_->calls.leave();
  health_->shut();
}

void Server::move() {
  core_->calls.close();
  core_->imaging.stop();
  core_->scenes.let_go();
  core_->calls.move();
  spdlog::info("event=move touches={}", core_->calls.count(CallKind::kTouch));
}

void Server::drain() {
  if (drained_) return;
  drained_ = true;
  const std::size_t open = core_->calls.count();
  spdlog::info("event=drain calls={}", open);
  health_->end();
  core_->calls.drain();
  core_->imaging.stop();
  core_->scenes.let_go();
  // Told streams get this long to end by themselves, then they are cancelled.
  const std::chrono::milliseconds patience(std::llround(1e3 * core_->limits.drain_s));
  core_->connections.end();
  server_->Shutdown(std::chrono::system_clock::now() + patience);
  server_->Wait();
  core_->calls.wait_until_none(Calls::Clock::now() + patience);
  spdlog::info("event=drained");
}

}  // namespace teletact::service
