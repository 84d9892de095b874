// Commands in this process, as the command line gives them, against a service that computes nothing: it
// answers what the test tells it to, and keeps what it was asked.
#pragma once

#include <grpcpp/grpcpp.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <exception>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "client/commands/commands.h"
#include "teletact/v1/elastography.grpc.pb.h"
#include "teletact/v1/info.grpc.pb.h"
#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client::test {

// Throws what the command throws.
inline void run_command(std::vector<std::string> words) {
  CLI::App app;
  add_commands(app);
  std::reverse(words.begin(), words.end());  // as CLI11 takes them
  app.parse(words);
}

// The one line of a command that fails; "" where it does not.
inline std::string failure_of(const std::vector<std::string>& words) {
  try {
    run_command(words);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

class InfoOfNothing final : public v1::Info::Service {
  grpc::Status GetInfo(grpc::ServerContext*, const v1::GetInfoRequest*, v1::GetInfoResponse*) override {
    return grpc::Status::OK;
  }
};

// Maps of 2 x 2 nodes of 10 kPa for every pair.
class TwoByTwoEstimates final : public v1::Elastography::Service {
 public:
  double mean_axial_strain = -0.01;  // set before a call
  int calls = 0;                     // so far; one at a time
  std::optional<int> aborted_call;   // which of them, from 1, ends with ABORTED
  v1::Acquisition acquisition;       // of the latest

  grpc::Status Estimate(
      grpc::ServerContext*,
      grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>* stream) override {
    for (v1::EstimateRequest request; stream->Read(&request);)
      if (request.has_acquisition()) acquisition = request.acquisition();
    if (++calls == aborted_call) return {grpc::StatusCode::ABORTED, "the service ends"};
    for (const char* name : {"youngs_modulus", "youngs_modulus_log_std", "valid"}) {
      v1::EstimateResponse response;
      v1::Map& map = *response.mutable_map()->mutable_map();
      map.set_name(name);
      for (int axis = 0; axis < 2; ++axis) {
        map.mutable_grid()->add_size(2);
        map.mutable_grid()->add_origin_m(0.005);
        map.mutable_grid()->add_spacing_m(0.01);
        map.mutable_values()->add_shape(2);
      }
      const bool valid = name == std::string("valid");
      const std::vector<float> values(4, name == std::string("youngs_modulus") ? 1e4F : 0.1F);
      map.mutable_values()->set_dtype(valid ? v1::DATA_TYPE_UINT8 : v1::DATA_TYPE_FLOAT32);
      if (valid)
        map.mutable_values()->set_data(std::string(4, '\1'));
      else
        map.mutable_values()->set_data(values.data(), values.size() * sizeof(float));
      stream->Write(response);
    }
    v1::EstimateResponse response;
    response.mutable_summary()->set_mean_axial_strain(mean_axial_strain);
    response.mutable_summary()->set_quality(0.9);
    stream->Write(response);
    return grpc::Status::OK;
  }
};

// Every scene is the one that the test gives; every touch is refused.
class OneScene final : public v1::Palpation::Service {
 public:
  std::optional<v1::Scene> scene;  // that exists; set before any call
  std::vector<v1::CreateSceneRequest> created() {
    const std::lock_guard lock(mutex_);
    return created_;
  }
  std::vector<v1::TouchOpen> opened() {
    const std::lock_guard lock(mutex_);
    return opened_;
  }

 private:
  grpc::Status ListScenes(grpc::ServerContext*, const v1::ListScenesRequest*,
                          v1::ListScenesResponse*) override {
    return grpc::Status::OK;
  }
  grpc::Status CreateScene(grpc::ServerContext*, const v1::CreateSceneRequest* request, v1::Scene*) override {
    if (scene) return {grpc::StatusCode::ALREADY_EXISTS, "scene_id is taken"};
    const std::lock_guard lock(mutex_);
    created_.push_back(*request);
    return grpc::Status::OK;
  }
  grpc::Status PublishSlice(grpc::ServerContext*, const v1::PublishSliceRequest*,
                            v1::PublishSliceResponse*) override {
    return grpc::Status::OK;
  }
  grpc::Status GetScene(grpc::ServerContext*, const v1::GetSceneRequest*, v1::Scene* out) override {
    if (!scene) return {grpc::StatusCode::NOT_FOUND, "scene is unknown"};
    *out = *scene;
    return grpc::Status::OK;
  }
  grpc::Status Touch(grpc::ServerContext*,
                     grpc::ServerReaderWriter<v1::TouchResponse, v1::TouchRequest>* stream) override {
    v1::TouchRequest request;
    stream->Read(&request);
    const std::lock_guard lock(mutex_);
    opened_.push_back(request.open());
    return {grpc::StatusCode::INVALID_ARGUMENT, "no touch here"};
  }

  std::mutex mutex_;
  std::vector<v1::CreateSceneRequest> created_;
  std::vector<v1::TouchOpen> opened_;
};

// On a socket of its own, or on a free port of this machine, for as long as this lives.
class CommandService {
 public:
  explicit CommandService(bool tcp = false) : address_("unix:" + (folder / "s").string()) {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort(tcp ? "127.0.0.1:0" : address_, grpc::InsecureServerCredentials(), &port);
    // A synchronous server's idle thread notices a shutdown only when its wait ends: 10 s by default.
    builder.SetSyncServerOption(grpc::ServerBuilder::CQ_TIMEOUT_MSEC, 100);
    for (grpc::Service* service : std::initializer_list<grpc::Service*>{&estimates, &info_, &palpation})
      builder.RegisterService(service);
    server_ = builder.BuildAndStart();
    if (!server_) throw std::runtime_error("cannot listen on " + address_);
    if (tcp) address_ = "127.0.0.1:" + std::to_string(port);
  }
  ~CommandService() { server_->Shutdown(std::chrono::system_clock::now()); }
  const std::string& address() const { return address_; }

  const TemporaryFolder folder;
  TwoByTwoEstimates estimates;
  OneScene palpation;

 private:
  std::string address_;
  InfoOfNothing info_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace teletact::client::test
