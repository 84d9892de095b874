// Poses whose squares are no numbers any more.
#include <google/protobuf/message.h>

#include <cmath>
#include <limits>

#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

// Every number of a message, and of those that it is made of.
void expect_finite(const google::protobuf::Message& message, const std::string& of) {
  using Field = google::protobuf::FieldDescriptor;
  const auto& reflection = *message.GetReflection();
  std::vector<const Field*> fields;
  reflection.ListFields(message, &fields);
  for (const Field* field : fields) {
    const std::string name = of + "." + field->name();
    const int count = field->is_repeated() ? reflection.FieldSize(message, field) : 1;
    for (int k = 0; k < count; ++k) {
      const bool many = field->is_repeated();
      if (field->cpp_type() == Field::CPPTYPE_MESSAGE)
        expect_finite(
            many ? reflection.GetRepeatedMessage(message, field, k) : reflection.GetMessage(message, field),
            name);
      if (field->cpp_type() == Field::CPPTYPE_DOUBLE) {
        EXPECT_TRUE(std::isfinite(many ? reflection.GetRepeatedDouble(message, field, k)
                                       : reflection.GetDouble(message, field)))
            << name;
      }
      if (field->cpp_type() == Field::CPPTYPE_FLOAT) {
        EXPECT_TRUE(std::isfinite(many ? reflection.GetRepeatedFloat(message, field, k)
                                       : reflection.GetFloat(message, field)))
            << name;
      }
    }
  }
}

TEST(TinyPoses, EveryFieldOfTheAnswerIsFinite) {
  RunningServer server;
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("plane")).ok());
  ASSERT_TRUE(server.create(solid_scene("solid", 8, 4, [](double, double, double) { return 10e3F; })).ok());
  constexpr double kMin = std::numeric_limits<double>::denorm_min();
  for (const std::string scene : {"plane", "solid"}) {
    Toucher toucher(server.channel(), scene);
    ASSERT_TRUE(toucher.opened());
    for (const double y_m : {kMin, 1e-310, 1e-200, 1e-162, 1e-100, 1e-20, 1e-13, 1e-11})
      for (const double x_m : {0.02, 0.02 + 1e-17, kMin}) {
        v1::TouchAnswer answer;
        ASSERT_TRUE(toucher.touch(x_m, y_m, &answer));
        expect_finite(answer, scene + " at " + std::to_string(std::log10(y_m)));
      }
  }
}

}  // namespace
}  // namespace teletact::service
