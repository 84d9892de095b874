// teletact-client slices: a stack of plane maps of a known modulus becomes a solid scene, slice by slice.
#include <grpcpp/client_context.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "client/commands/commands.h"
#include "client/files/metaimage.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "client/patient/solid_patient.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {
namespace {

struct SlicesArguments {
  std::string address, scene_id, volume, log_std;
  Credentials credentials;
  std::uint64_t seed = 1;
  double poisson_ratio = SolidPatient::kPoissonRatio, every_s = 0;
  bool linear = false;
};

class Stack {
 public:
  // Throws CommandError where the volume is no such stack.
  explicit Stack(const MetaImage& image, const std::string& name)
      : image_(image), values_(image.as<float>()) {
    const auto refuse = [&](const std::string& why) { throw CommandError(name + ": " + why); };
    if (image.size.size() != 3 || image.channels != 1)
      refuse("slices take one value for each element along x, y and z (NDims = 3, one channel)");
    if (image.spacing.empty() || image.origin.empty())
      refuse("ElementSpacing and Offset say where the slices lie, in metres; add them to the header");
    for (const std::size_t axis : {0, 1})
      if (!(std::abs(image.origin[axis] - image.spacing[axis] / 2) <= 1e-3 * image.spacing[axis]))
        refuse("its Offset must be half of an ElementSpacing along x and y: tissue begins at 0");
  }
  std::size_t slices() const { return image_.size[2]; }
  double z_m(std::size_t k) const { return image_.origin[2] + static_cast<double>(k) * image_.spacing[2]; }
  double size_m(std::size_t axis) const {
    return static_cast<double>(image_.size[axis]) * image_.spacing[axis];
  }
  v1::Array plane(std::size_t k) const {
    v1::Array array;
    array.set_dtype(v1::DATA_TYPE_FLOAT32);
    for (const std::size_t n : {image_.size[1], image_.size[0]}) array.add_shape(static_cast<unsigned>(n));
    const std::size_t plane = image_.size[0] * image_.size[1];
    array.set_data(values_.data() + k * plane, plane * sizeof(float));
    return array;
  }
  // Without slices.
  v1::CreateSceneRequest scene(const SlicesArguments& arguments) const {
    v1::CreateSceneRequest out;
    out.set_scene_id(arguments.scene_id);
    for (const std::size_t axis : {0, 1}) out.mutable_geometry()->add_size_m(size_m(axis));
    out.mutable_geometry()->set_poisson_ratio(arguments.poisson_ratio);
    out.mutable_geometry()->set_has_poisson_ratio(true);
    out.mutable_geometry()->set_linear(arguments.linear || arguments.volume.empty());
    const auto node = [&](std::size_t axis, std::size_t n) {
      return (axis < 2 ? 0 : z_m(0) - image_.spacing[2] / 2) + static_cast<double>(n) * image_.spacing[axis];
    };
    for (std::size_t n = 0; n <= image_.size[0]; ++n) out.mutable_modulus()->add_x_m(node(0, n));
    for (std::size_t n = 0; n <= image_.size[1]; ++n) out.mutable_modulus()->add_y_m(node(1, n));
    for (std::size_t n = 0; n <= image_.size[2]; ++n) out.mutable_modulus()->add_z_m(node(2, n));
    return out;
  }

 private:
  const MetaImage& image_;
  std::vector<float> values_;
};

template <class Call>
void call(const std::string& what, const std::string& scene_id, Call&& one) {
  constexpr std::chrono::seconds kPatience{30};
  grpc::ClientContext context;
  name_scene(context, scene_id);
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const grpc::Status status = one(context);
  if (!status.ok()) throw CommandError("cannot " + what + ": " + describe(status));
}

void run(const SlicesArguments& arguments) {
  const MetaImage image = arguments.volume.empty() ? modulus_volume(random_solid_patient(arguments.seed))
                                                   : read_metaimage(arguments.volume);
  const Stack stack(image, arguments.volume.empty() ? "--seed" : arguments.volume);
  const std::optional<MetaImage> log_std =
      arguments.log_std.empty() ? std::nullopt : std::optional(read_metaimage(arguments.log_std));
  const auto deviation =
      log_std ? std::optional<Stack>(std::in_place, *log_std, arguments.log_std) : std::nullopt;
  if (log_std && log_std->size != image.size)
    throw CommandError(arguments.log_std + ": give one value for each element of the volume");
  const auto slice = [&](std::size_t k) {
    v1::ModulusSlice out;
    for (const double o : {0.0, 0.0, stack.z_m(k)}) out.mutable_pose()->add_origin_m(o);
    *out.mutable_modulus()->mutable_youngs_modulus_pa() = stack.plane(k);
    if (deviation) *out.mutable_youngs_modulus_log_std() = deviation->plane(k);
    return out;
  };
  const auto stub = v1::Palpation::NewStub(reach_service(arguments.address, arguments.credentials, say));
  v1::CreateSceneRequest wanted = stack.scene(arguments);
  *wanted.add_slices() = slice(0);
  v1::Scene scene;
  call("make scene '" + arguments.scene_id + "'", arguments.scene_id,
       [&](grpc::ClientContext& context) { return stub->CreateScene(&context, wanted, &scene); });
  const auto told = [&](std::size_t k, std::uint64_t version) {
    std::printf("slice %zu of %zu at z %.1f mm can be touched: version %llu\n", k + 1, stack.slices(),
                1e3 * stack.z_m(k), static_cast<unsigned long long>(version));
    std::fflush(stdout);
  };
  told(0, scene.version());
  for (std::size_t k = 1; k < stack.slices(); ++k) {
    std::this_thread::sleep_for(std::chrono::duration<double>(arguments.every_s));
    v1::PublishSliceRequest request;
    request.set_scene_id(arguments.scene_id);
    *request.mutable_slice() = slice(k);
    v1::PublishSliceResponse response;
    call("publish slice " + std::to_string(k + 1), arguments.scene_id,
         [&](grpc::ClientContext& context) { return stub->PublishSlice(&context, request, &response); });
    told(k, response.version());
    for (const std::string& warning : response.warnings()) say("warning: " + warning);
  }
}

}  // namespace

void add_slices_command(CLI::App& app) {
  const auto arguments = std::make_shared<SlicesArguments>();
  CLI::App& command = *app.add_subcommand(
      "slices", "make a solid scene of a stack of plane maps of a known modulus, slice by slice");
  add_service_options(command, arguments->address, arguments->credentials);
  command.add_option("--scene", arguments->scene_id, "scene to make; one of that name is refused")
      ->required();
  CLI::Option* volume = command.add_option(
      "--volume", arguments->volume,
      "Young's modulus (Pa) as a MetaImage (.mha) along x, y and z; without it a simulated patient's");
  command.add_option("--seed", arguments->seed, "which simulated patient")->excludes(volume);
  command
      .add_option("--log-std", arguments->log_std,
                  "standard deviation of the modulus' logarithm, of the volume's elements (.mha); without it "
                  "the modulus is taken as exact")
      ->needs(volume);
  command.add_option("--poisson-ratio", arguments->poisson_ratio, "of all of it, below 0.5")
      ->check(zero_or_more());
  command
      .add_flag("--linear", arguments->linear,
                "the tissue does not stiffen with strain: a phantom; a simulated patient always")
      ->needs(volume);
  command.add_option("--every-s", arguments->every_s, "wait so long before each further slice")
      ->check(zero_or_more());
  command.callback([arguments] { run(*arguments); });
}

}  // namespace teletact::client
