// Who looks on at a scene for the page: what it asks for, and that it comes back after whatever ends it.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "client/watch/sources.h"
#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/watch/web_peer.h"

namespace teletact::client {
namespace {

// A service whose every stream tells one scene and a surface; the first one ends then, the others go on.
class OneScene final : public v1::Palpation::Service {
 public:
  grpc::Status Observe(grpc::ServerContext*,
                       grpc::ServerReaderWriter<v1::Observation, v1::ObserveRequest>* stream) override {
    v1::ObserveRequest request;
    if (!stream->Read(&request)) return grpc::Status::OK;
    {
      const std::lock_guard lock(mutex_);
      opens_.push_back(request.open());
    }
    v1::Observation state;
    state.mutable_scene()->set_scene_id(request.open().scene_id());
    state.mutable_scene()->set_version(++streams);
    v1::DeformedSurface& surface = *state.mutable_surface();
    surface.add_x_m(0.01), surface.add_z_m(0);
    surface.mutable_displacement_m()->set_dtype(v1::DATA_TYPE_FLOAT32);
    surface.mutable_displacement_m()->set_data(std::string(sizeof(float), '\0'));
    state.set_state(1);
    stream->Write(state);
    if (!stream->Read(&request) || request.acknowledged() != 1)
      return {grpc::StatusCode::INVALID_ARGUMENT, "not acknowledged"};
    if (streams == 1) return {grpc::StatusCode::UNAVAILABLE, "gone for a moment"};
    while (stream->Read(&request)) {  // says no more
    }
    return grpc::Status::OK;
  }
  std::vector<v1::ObserveOpen> opens() {
    const std::lock_guard lock(mutex_);
    return opens_;
  }
  std::atomic<std::uint64_t> streams{0};

 private:
  std::mutex mutex_;
  std::vector<v1::ObserveOpen> opens_;
};

TEST(SceneSource, ReopensAnEndedStreamAndEndsAtOnce) {
  const std::string socket =
      (std::filesystem::temp_directory_path() / ("teletact-scene-source-" + std::to_string(getpid())))
          .string();
  const std::string address = "unix:" + socket;
  OneScene service;
  grpc::ServerBuilder builder;
  builder.AddListeningPort(address, grpc::InsecureServerCredentials());
  builder.RegisterService(&service);
  const auto server = builder.BuildAndStart();
  ASSERT_TRUE(server);
  View view;
  View::Seen seen;
  std::map<std::uint32_t, test::WebSlot> newest;
  const auto until = [&](auto met) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!met() && std::chrono::steady_clock::now() < end) {
      for (const auto& [channel, slot] : test::decoded(frame(1, view.news(seen))).slots)
        newest[channel] = slot;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return met();
  };
  const auto of = [&](Channel channel) -> const nlohmann::json& {
    nlohmann::json& json = newest[static_cast<std::uint32_t>(channel)].json;
    return json.is_null() ? json = nlohmann::json::object() : json;
  };
  {
    const SceneSource source(address, {}, "liver", view);
    ASSERT_TRUE(until([&] {
      return of(Channel::kScene).value("version", 0) == 2 && of(Channel::kSurface).contains("arrays");
    })) << "of the second stream";
    EXPECT_EQ(of(Channel::kScene)["scene_id"], "liver");
    ASSERT_TRUE(until([&] { return of(Channel::kStatus).value("service_state", "") == "answers"; }));
  }  // while the service says nothing
  ASSERT_TRUE(until([&] { return !of(Channel::kSurface).contains("arrays"); })) << "nobody tells it any more";
  const std::vector<v1::ObserveOpen> opens = service.opens();
  ASSERT_EQ(opens.size(), 2U);
  EXPECT_TRUE(opens[1].windows() && opens[1].surface());
  EXPECT_FALSE(opens[1].answers()) << "the session's own are shown";
  EXPECT_EQ(opens[1].maps_size(), 4);
  server->Shutdown(std::chrono::system_clock::now());
  std::filesystem::remove(socket);
}

}  // namespace
}  // namespace teletact::client
