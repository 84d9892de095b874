#include "service/rpc/open_service.h"

#include <fmt/format.h>
#include <grpcpp/impl/rpc_service_method.h>

#include <optional>
#include <utility>
#include <vector>

#include "service/rpc/call_life.h"
#include "service/rpc/status.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

class UnknownMethod final : public grpc::ServerGenericBidiReactor {
 public:
  UnknownMethod(Connections& connections, const grpc::ServerContextBase& context)
      : call_(connections, context, true) {
    call_.waste();
    Finish({grpc::StatusCode::UNIMPLEMENTED, "there is no such method"});
  }
  void OnDone() override { delete this; }

 private:
  CallOfConnection call_;
};

}  // namespace

// Says how a service is, and again whenever that changes.
class HealthWatch final : public grpc::ServerWriteReactor<HealthService::Response> {
 public:
  HealthWatch(HealthService& service, std::string of) : service_(service), of_(std::move(of)) {}

  void begin(std::shared_ptr<HealthWatch> self, const grpc::Status& allowed) {
    self_ = std::move(self);
    if (!allowed.ok()) end(allowed);
    tell();
  }
  // Says what has changed, once what was said is taken.
  void tell() {
    if (!life_.begin()) return;
    {
      const std::lock_guard lock(mutex_);
      const auto status = service_.of(of_);
      if (!writing_ && status != said_) {
        said_ = status, writing_ = true;
        response_.set_value(status);
        return StartWrite(&response_);  // over when it is written
      }
    }
    finish_if(life_.over());
  }
  void end(const grpc::Status& status) { finish_if(life_.end(status)); }

 private:
  void OnWriteDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      writing_ = false;
    }
    if (!ok) end(grpc::Status::CANCELLED);
    finish_if(life_.over());
    tell();
  }
  void OnCancel() override { end(grpc::Status::CANCELLED); }
  void OnDone() override {
    service_.leave(self_);
    const auto last = std::move(self_);
  }
  void finish_if(bool due) {
    if (due) Finish(life_.status());
  }

  HealthService& service_;
  const std::string of_;
  CallLife life_;
  std::mutex mutex_;  // of the next three
  std::optional<HealthService::Status> said_;
  bool writing_ = false;
  HealthService::Response response_;
  std::shared_ptr<HealthWatch> self_;
};

HealthService::HealthService() {
  using grpc::internal::RpcMethod;
  using grpc::internal::RpcServiceMethod;
  AddMethod(new RpcServiceMethod("/grpc.health.v1.Health/Check", RpcMethod::NORMAL_RPC, nullptr));
  MarkMethodCallback(0, new grpc::internal::CallbackUnaryHandler<Request, Response>(
                            [this](grpc::CallbackServerContext* context, const Request* request,
                                   Response* response) { return check(context, *request, response); }));
  AddMethod(new RpcServiceMethod("/grpc.health.v1.Health/Watch", RpcMethod::SERVER_STREAMING, nullptr));
  MarkMethodCallback(1, new grpc::internal::CallbackServerStreamingHandler<Request, Response>(
                            [this](grpc::CallbackServerContext* context, const Request* request) {
                              return watch(context, *request);
                            }));
}

grpc::ServerUnaryReactor* HealthService::check(grpc::CallbackServerContext* context, const Request& request,
                                               Response* response) {
  auto* call = context->DefaultReactor();
  call->Finish(guarded([&] {
    require_short_headers(*context);
    const Status status = of(request.value());
    if (status == kServiceUnknown)
      return grpc::Status(grpc::StatusCode::NOT_FOUND, "service: this one is not known");
    response->set_value(status);
    return grpc::Status::OK;
  }));
  return call;
}

grpc::ServerWriteReactor<HealthService::Response>* HealthService::watch(grpc::CallbackServerContext* context,
                                                                        const Request& request) {
  const auto call = std::make_shared<HealthWatch>(*this, request.value());
  call->begin(call, guarded([&] {
                require_short_headers(*context);
                join(call);
                return grpc::Status::OK;
              }));
  return call.get();  // not done before gRPC has it
}

void HealthService::set(const std::string& service, bool serving) {
  {
    const std::lock_guard lock(mutex_);
    if (shut_) return;
    serving_[service] = serving;
  }
  tell();
}

void HealthService::shut() {
  {
    const std::lock_guard lock(mutex_);
    shut_ = true;
    for (auto& [service, serving] : serving_) serving = false;
  }
  tell();
}

HealthService::Status HealthService::of(const std::string& service) {
  const std::lock_guard lock(mutex_);
  const auto found = serving_.find(service);
  if (found == serving_.end()) return kServiceUnknown;
  return found->second ? kServing : kNotServing;
}

void HealthService::join(const std::shared_ptr<HealthWatch>& watch) {
  const std::lock_guard lock(mutex_);
  if (watches_.size() >= kMaxWatches)
    throw Error(ErrorKind::kExhausted,
                fmt::format("all {} places for watches of health are taken; ask with Check", kMaxWatches));
  watches_.insert(watch);
}

void HealthService::leave(const std::shared_ptr<HealthWatch>& watch) {
  const std::lock_guard lock(mutex_);
  watches_.erase(watch);
}

std::vector<std::shared_ptr<HealthWatch>> HealthService::watches() {
  const std::lock_guard lock(mutex_);
  return {watches_.begin(), watches_.end()};
}

void HealthService::tell() {
  for (const auto& watch : watches()) watch->tell();
}

void HealthService::end() {
  shut();
  for (const auto& watch : watches())
    watch->end({grpc::StatusCode::UNAVAILABLE, "the service is shutting down; connect again later"});
}

grpc::ServerGenericBidiReactor* UnknownMethods::CreateReactor(grpc::GenericCallbackServerContext* context) {
  return new UnknownMethod(connections_, *context);
}

}  // namespace teletact::service
