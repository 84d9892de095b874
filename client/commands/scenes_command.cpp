// teletact-client scenes: what a service holds, and taking a scene away.
#include <grpcpp/client_context.h>

#include <chrono>
#include <cstdio>
#include <memory>
#include <string>

#include "client/commands/commands.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {
namespace {

struct ScenesArguments {
  std::string address, remove;
  Credentials credentials;
};

void give_deadline(grpc::ClientContext& context) {
  constexpr std::chrono::seconds kPatience{10};
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
}

void print(const v1::Scene& scene) {
  std::printf("%s  %s, %.3f x %.3f m, version %lu, %d windows:", scene.scene_id().c_str(), kind_of(scene),
              scene.geometry().size_m(0), scene.geometry().size_m(1),
              static_cast<unsigned long>(scene.version()), scene.windows_size());
  for (const v1::Window& window : scene.windows())
    std::printf(" [%.3f, %.3f)", window.covers().begin_x_m(), window.covers().end_x_m());
  std::printf("\n");
  if (!scene.tissue().empty()) std::printf("    tissue %s\n", scene.tissue().c_str());
  for (const v1::Window& window : scene.windows())
    for (const std::string& warning : window.evidence().warnings())
      std::printf("    [%.3f, %.3f) doubtful: %s\n", window.covers().begin_x_m(), window.covers().end_x_m(),
                  warning.c_str());
}

void run(const ScenesArguments& arguments) {
  const auto stub = v1::Palpation::NewStub(reach_service(arguments.address, arguments.credentials, say));
  grpc::ClientContext context;
  give_deadline(context);
  if (!arguments.remove.empty()) {
    v1::DeleteSceneRequest request;
    request.set_scene_id(arguments.remove);
    name_scene(context, arguments.remove);
    v1::DeleteSceneResponse response;
    const grpc::Status status = stub->DeleteScene(&context, request, &response);
    if (!status.ok()) throw CommandError("cannot delete: " + describe(status));
    std::printf("deleted %s\n", arguments.remove.c_str());
    return;
  }
  v1::ListScenesResponse scenes;
  const grpc::Status status = stub->ListScenes(&context, {}, &scenes);
  if (!status.ok()) throw CommandError("cannot list the scenes: " + describe(status));
  for (const v1::Scene& scene : scenes.scenes()) print(scene);
  if (scenes.scenes().empty()) std::printf("no scenes: acquire or slices publishes one\n");
}

}  // namespace

void add_scenes_command(CLI::App& app) {
  const auto arguments = std::make_shared<ScenesArguments>();
  CLI::App& command = *app.add_subcommand("scenes", "list the scenes of a service, or delete one");
  add_service_options(command, arguments->address, arguments->credentials);
  command.add_option("--delete", arguments->remove,
                     "the scene to take away; open touch streams end with it; without it the scenes are "
                     "listed");
  command.callback([arguments] { run(*arguments); });
}

}  // namespace teletact::client
