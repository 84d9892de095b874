// What is running here.
#pragma once

#include "service/rpc/core.h"
#include "teletact/v1/info.grpc.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class InfoService final : public v1::Info::CallbackService {
 public:
  explicit InfoService(Core& core) : core_(core) {}
  grpc::ServerUnaryReactor* GetInfo(grpc::CallbackServerContext*, const v1::GetInfoRequest*,
                                    v1::GetInfoResponse*) override;

 private:
  void describe(v1::GetInfoResponse*) const;
  Core& core_;
};

}  // namespace teletact::service
