// Health as probes watch it.
#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/support/sync_stream.h>

#include <memory>
#include <string>
#include <vector>

#include "service/rpc/open_service.h"
#include "tests/rpc/health.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

class Watch {
 public:
  Watch(std::shared_ptr<grpc::Channel> channel, const std::string& service) : channel_(std::move(channel)) {
    set_deadline(context_);
    HealthService::Request request;
    request.set_value(service);
    stream_.reset(grpc::internal::ClientReaderFactory<HealthService::Response>::Create(
        channel_.get(), method_, &context_, request));
  }
  ~Watch() { context_.TryCancel(); }
  // 0: it has ended.
  int next() {
    HealthService::Response response;
    return stream_->Read(&response) ? response.value() : 0;
  }
  grpc::Status finish() { return stream_->Finish(); }

 private:
  const std::shared_ptr<grpc::Channel> channel_;
  const grpc::internal::RpcMethod method_{"/grpc.health.v1.Health/Watch",
                                          grpc::internal::RpcMethod::SERVER_STREAMING};
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<HealthService::Response>> stream_;
};

TEST(HealthWatch, IsToldOfEachChangeUntilTheServiceStops) {
  RunningServer server;
  Watch watch(server.channel(), kElastography), other(server.channel(), "no.such.Service");
  EXPECT_EQ(other.next(), HealthService::kServiceUnknown);
  EXPECT_EQ(watch.next(), kNotServing);
  server->make_ready();
  EXPECT_EQ(watch.next(), kServing);
  server->leave();
  EXPECT_EQ(watch.next(), kNotServing);
  server->drain();
  EXPECT_EQ(watch.next(), 0);
  EXPECT_EQ(watch.finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST(HealthWatch, NoMoreThanStatedAndAProbeIsAnswered) {
  RunningServer server;
  server->make_ready();
  std::vector<std::unique_ptr<Watch>> watches;
  auto channel = server.channel();
  for (std::size_t k = 0; k <= HealthService::kMaxWatches; ++k) {
    if (k % 128 == 0) channel = server.channel();  // fewer than calls of one connection
    watches.push_back(std::make_unique<Watch>(channel, ""));
    EXPECT_EQ(watches.back()->next(), k < HealthService::kMaxWatches ? kServing : 0) << k;
  }
  EXPECT_EQ(watches.back()->finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(health_of(server, ""), kServing);
  watches.clear();
  for (int k = 0; k < 1000 && Watch(server.channel(), "").next() == 0; ++k) continue;
  EXPECT_EQ(Watch(server.channel(), "").next(), kServing) << "their places come back";
}

}  // namespace
}  // namespace teletact::service
