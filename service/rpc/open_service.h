// What is open to whoever can connect: the standard health service, and the answer to methods that there are
// not. Both count as calls of their connection.
#pragma once

#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/impl/service_type.h>
#include <grpcpp/support/server_callback.h>

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "service/rpc/call_of_connection.h"

namespace teletact::service {

class HealthWatch;

// grpc.health.v1.Health: its messages have one field each, as those of the wrappers. Thread-safe.
class HealthService final : public grpc::Service {
 public:
  using Request = google::protobuf::StringValue;
  using Response = google::protobuf::Int32Value;
  enum Status { kServing = 1, kNotServing = 2, kServiceUnknown = 3 };
  static constexpr std::size_t kMaxWatches = 256;

  HealthService();
  void set(const std::string& service, bool serving);
  // Nothing is serving from now on.
  void shut();
  // Watches end, too.
  void end();

 private:
  friend class HealthWatch;
  grpc::ServerUnaryReactor* check(grpc::CallbackServerContext*, const Request&, Response*);
  grpc::ServerWriteReactor<Response>* watch(grpc::CallbackServerContext*, const Request&);
  Status of(const std::string& service);
  void join(const std::shared_ptr<HealthWatch>&);
  void leave(const std::shared_ptr<HealthWatch>&);
  std::vector<std::shared_ptr<HealthWatch>> watches();
  void tell();

  std::mutex mutex_;
  std::map<std::string, bool> serving_;
  bool shut_ = false;
  std::set<std::shared_ptr<HealthWatch>> watches_;
};

class UnknownMethods final : public grpc::CallbackGenericService {
 public:
  explicit UnknownMethods(Connections& connections) : connections_(connections) {}
  grpc::ServerGenericBidiReactor* CreateReactor(grpc::GenericCallbackServerContext*) override;

 private:
  Connections& connections_;
};

}  // namespace teletact::service
