// A server in this process on a Unix socket, tests that share one, and clients that speak to it as others
// would.
#pragma once

#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "service/rpc/server.h"
#include "teletact/v1/elastography.grpc.pb.h"
#include "teletact/v1/info.grpc.pb.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// One opened device for all tests: opening and compiling costs more than the tests.
inline const std::shared_ptr<Device>& rpc_device() {
  static const std::shared_ptr<Device> device = [] {
    spdlog::set_level(spdlog::level::off);
    DeviceOptions options;
    options.niceness = 5;
    return Device::open(options);
  }();
  return device;
}

// So that a test that hangs ends: far above what the busiest machine takes for a whole test.
inline void set_deadline(grpc::ClientContext& context) {
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::minutes(2));
}

// A status that says no with this code, and with these words: the field, or the remedy.
inline void expect_refused(const grpc::Status& status, grpc::StatusCode code, const std::string& words) {
  EXPECT_EQ(status.error_code(), code) << status.error_message();
  EXPECT_NE(status.error_message().find(words), std::string::npos) << status.error_message();
}

class RunningServer {
 public:
  explicit RunningServer(const std::string& listen = "", const std::filesystem::path& state = "",
                         const Limits& limits = {},
                         std::shared_ptr<const TouchModels> models = tissue_models(),
                         const std::vector<DeviceOptions>& devices = {}, bool standby = false,
                         const SlowTimes& slow = {}, const ConnectionLimits& connections = {}) {
    static int count = 0;
    folder_ = std::filesystem::temp_directory_path() /
              ("teletact-rpc-" + std::to_string(getpid()) + "-" + std::to_string(count++));
    std::filesystem::create_directories(folder_);
    ServerOptions options;
    options.listen.listen = listen.empty() ? "unix:" + (folder_ / "s").string() : listen;
    options.state_directory = state;
    options.standby = standby;
    options.slow = slow;
    options.reopen = [devices](std::size_t number) {
      return Device::open(devices.empty() ? DeviceOptions{} : devices.at(number));
    };
    options.limits = limits;
    options.connections = connections;
    options.models = std::move(models);
    server_ = std::make_unique<Server>(opened(devices), options);
    palpation_ = v1::Palpation::NewStub(channel());
  }
  ~RunningServer() {
    server_.reset();
    std::filesystem::remove_all(folder_);
  }
  Server& operator*() { return *server_; }
  Server* operator->() { return server_.get(); }
  // A connection of its own, as another process would have.
  std::shared_ptr<grpc::Channel> channel() const {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetMaxReceiveMessageSize(-1);
    return grpc::CreateCustomChannel(server_->address(), grpc::InsecureChannelCredentials(), arguments);
  }
  grpc::Status create(const v1::CreateSceneRequest& request, const std::string& client = "",
                      v1::Scene* made = nullptr) const {
    grpc::ClientContext context;
    set_deadline(context);
    if (!client.empty()) context.AddMetadata("teletact-client", client);
    v1::Scene scene;
    return palpation_->CreateScene(&context, request, made ? made : &scene);
  }
  grpc::Status remove(const std::string& scene_id) const {
    grpc::ClientContext context;
    set_deadline(context);
    v1::DeleteSceneRequest request;
    request.set_scene_id(scene_id);
    v1::DeleteSceneResponse response;
    return palpation_->DeleteScene(&context, request, &response);
  }
  // Every place that a call holds comes back.
  void expect_all_calls_end() const {
    server_->core().calls.wait_until_none(Calls::Clock::now() + std::chrono::minutes(1));
    EXPECT_EQ(server_->core().calls.count(), 0U);
  }

 private:
  static std::vector<std::shared_ptr<Device>> opened(const std::vector<DeviceOptions>& devices) {
    std::vector<std::shared_ptr<Device>> all;
    for (const DeviceOptions& device : devices) all.push_back(Device::open(device));
    return devices.empty() ? std::vector{rpc_device()} : all;
  }
  std::filesystem::path folder_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<v1::Palpation::Stub> palpation_;
};

// A request for a scene of uniform modulus on 2 mm elements, touchable at once.
inline void set_values(v1::Array* array, std::initializer_list<std::size_t> shape,
                       const std::vector<float>& values) {
  array->set_dtype(v1::DATA_TYPE_FLOAT32);
  for (const std::size_t n : shape) array->add_shape(static_cast<std::uint32_t>(n));
  array->set_data(values.data(), values.size() * sizeof(float));
}

// 40 x 20 mm, around z = 0: 20 columns of 2 mm, so many rows, slices of 2 mm. Without `modulus_pa`, of the
// middle of an element (x, y, z), its nodes alone.
inline v1::CreateSceneRequest solid_scene(
    const std::string& id, std::size_t rows, std::size_t slices,
    const std::function<float(double, double, double)>& modulus_pa = nullptr) {
  constexpr std::size_t kColumns = 20;
  constexpr double kSpacingM = 0.002, kDepthM = 0.02;
  const double row_m = kDepthM / double(rows), begin_z_m = -kSpacingM * double(slices) / 2;
  v1::CreateSceneRequest request;
  request.set_scene_id(id);
  for (const double size_m : {kSpacingM * kColumns, kDepthM}) request.mutable_geometry()->add_size_m(size_m);
  v1::ModulusMap* map = request.mutable_modulus();
  for (std::size_t i = 0; i <= kColumns; ++i) map->add_x_m(kSpacingM * double(i));
  for (std::size_t j = 0; j <= rows; ++j) map->add_y_m(row_m * double(j));
  for (std::size_t k = 0; k <= slices; ++k) map->add_z_m(begin_z_m + kSpacingM * double(k));
  if (!modulus_pa) return request;
  std::vector<float> values;
  for (std::size_t k = 0; k < slices; ++k)
    for (std::size_t j = 0; j < rows; ++j)
      for (std::size_t i = 0; i < kColumns; ++i)
        values.push_back(modulus_pa(kSpacingM * (double(i) + 0.5), row_m * (double(j) + 0.5),
                                    begin_z_m + kSpacingM * (double(k) + 0.5)));
  set_values(map->mutable_youngs_modulus_pa(), {slices, rows, kColumns}, values);
  return request;
}

inline v1::CreateSceneRequest uniform_scene(const std::string& id, double modulus_pa = 10e3,
                                            double width_m = 0.1, double depth_m = 0.04) {
  v1::CreateSceneRequest request;
  request.set_scene_id(id);
  request.mutable_geometry()->add_size_m(width_m);
  request.mutable_geometry()->add_size_m(depth_m);
  const int columns = static_cast<int>(std::lround(width_m / 0.002)),
            rows = static_cast<int>(std::lround(depth_m / 0.002));
  v1::ModulusMap* map = request.mutable_modulus();
  for (int i = 0; i <= columns; ++i) map->add_x_m(width_m * i / columns);
  for (int j = 0; j <= rows; ++j) map->add_y_m(depth_m * j / rows);
  const std::vector<float> values(static_cast<std::size_t>(columns * rows), static_cast<float>(modulus_pa));
  set_values(map->mutable_youngs_modulus_pa(), {std::size_t(rows), std::size_t(columns)}, values);
  return request;
}

// Tests that share one server, which has a scene "s". Each begins with nobody served.
class OnOneServer : public testing::Test {
 protected:
  static void SetUpTestSuite() { serve(); }
  static void TearDownTestSuite() { server.reset(); }
  static void serve(const Limits& limits = {}, std::shared_ptr<const TouchModels> models = tissue_models()) {
    server = std::make_unique<RunningServer>("", "", limits, std::move(models));
    (*server)->make_ready();
    ASSERT_TRUE(server->create(uniform_scene("s")).ok());
  }
  void TearDown() override { server->expect_all_calls_end(); }

  static inline std::unique_ptr<RunningServer> server;
  const std::shared_ptr<grpc::Channel> channel = server->channel();
};

// A touch stream, driven one message at a time.
class Toucher {
 public:
  Toucher(const std::shared_ptr<grpc::Channel>& channel, const v1::TouchOpen& open,
          const std::string& client = "")
      : stub_(v1::Palpation::NewStub(channel)) {
    set_deadline(context_);
    if (!client.empty()) context_.AddMetadata("teletact-client", client);
    stream_ = stub_->Touch(&context_);
    v1::TouchRequest request;
    *request.mutable_open() = open;
    stream_->Write(request);
  }
  Toucher(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene)
      : Toucher(channel, open_on(scene)) {}
  ~Toucher() { context_.TryCancel(); }

  static v1::TouchOpen open_on(const std::string& scene) {
    v1::TouchOpen open;
    open.set_scene_id(scene);
    open.set_period_s(0.001);
    return open;
  }
  // False when the stream has ended.
  bool opened(v1::TouchOpened* out = nullptr) {
    v1::TouchResponse response;
    if (!stream_->Read(&response)) return false;
    if (out) *out = response.opened();
    return response.has_opened();
  }
  bool send(double x_m, double y_m) {
    v1::TouchRequest request;
    request.mutable_pose()->add_position_m(x_m);
    request.mutable_pose()->add_position_m(y_m);
    return send(request);
  }
  bool send(v1::TouchRequest& request) {
    v1::ContactPose* pose = request.mutable_pose();
    if (pose->sequence() == 0) pose->set_sequence(++sequence_);
    pose->set_acknowledged(acknowledge_ ? read_ : 0);
    return stream_->Write(request);
  }
  bool send_as_is(const v1::TouchRequest& request) { return stream_->Write(request); }
  bool read(v1::TouchResponse* response) {
    if (!stream_->Read(response)) return false;
    if (response->has_answer()) read_ = response->answer().answer();
    return true;
  }
  bool read(v1::TouchAnswer* answer) {
    v1::TouchResponse response;
    if (!read(&response)) return false;
    *answer = response.answer();
    return response.has_answer();
  }
  // One pose and its answer; false when the stream has ended.
  // The first answer after what is touched has been made ready.
  bool touch(double x_m, double y_m, v1::TouchAnswer* answer) {
    do {
      if (!send(x_m, y_m) || !read(answer)) return false;
    } while (answer->status() == v1::TOUCH_STATUS_PREPARING);
    return true;
  }
  // Half-closes; `unread` counts the answers that were still to come.
  grpc::Status finish(std::size_t* unread = nullptr) {
    stream_->WritesDone();
    v1::TouchResponse rest;
    std::size_t count = 0;
    while (stream_->Read(&rest)) ++count;
    if (unread) *unread = count;
    return stream_->Finish();
  }
  void stop_acknowledging() { acknowledge_ = false; }
  std::uint64_t sequence() const { return sequence_; }
  grpc::ClientContext& context() { return context_; }

 private:
  std::unique_ptr<v1::Palpation::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>> stream_;
  std::uint64_t sequence_ = 0, read_ = 0;
  bool acknowledge_ = true;
};

}  // namespace teletact::service
