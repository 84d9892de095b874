#include "client/link/credentials.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "client/link/channel.h"
#include "tests/files/temporary_folder.h"
#include "tests/support/certificates.h"
#include "tests/support/fake_service.h"

namespace teletact::client {
namespace {

std::string why_refused(const std::function<void()>& done) {
  try {
    done();
    return "";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    return error.what();
  }
}

// Whoever reads the token on the way may do what its owner may.
TEST(Credentials, ATokenLeavesThisMachineEncryptedAlone) {
  const Credentials token{.token = "secret"};
  const auto why = [](const Credentials& credentials, const char* address) {
    return why_refused([&] { require_usable(credentials, address); });
  };
  for (const char* address : {"127.0.0.1:1", "127.9.9.9:1", "localhost:1", "[::1]:1", "unix:/tmp/s",
                              "unix-abstract:s", "ipv4:127.0.0.1:1", "dns:localhost:1", "ipv6:[::1]:1"})
    EXPECT_EQ(why(token, address), "") << address;
  for (const char* address :
       {"node7:1", "10.0.0.7:1", "127.0.0.1.evil.org:1", "localhost.evil.org:1", "[fd00::1]:1", "dns:node7:1",
        "dns://8.8.8.8/localhost:1", "ipv4:10.0.0.7:1", "ipv6:[::1]:1,[2001:db8::1]:1"}) {
    EXPECT_NE(why(token, address).find("--tls-ca"), std::string::npos) << address;
    EXPECT_EQ(why(token, address).find("secret"), std::string::npos) << address;
    EXPECT_EQ(why({.tls_ca = "ca", .token = "secret"}, address), "") << address;
    EXPECT_EQ(why({}, address), "") << address;
    EXPECT_THROW(make_channel(address, token), std::runtime_error) << address;
  }
}

TEST(Credentials, ACertificateTakesItsKeyAndEncryption) {
  const auto why = [](const Credentials& credentials) {
    return why_refused([&] { require_usable(credentials, "node7:1"); });
  };
  EXPECT_NE(why({.tls_ca = "ca", .tls_certificate = "c"}).find("both or none"), std::string::npos);
  EXPECT_NE(why({.tls_ca = "ca", .tls_key = "k"}).find("both or none"), std::string::npos);
  EXPECT_NE(why({.tls_certificate = "c", .tls_key = "k"}).find("--tls-ca"), std::string::npos);
  EXPECT_EQ(why({.tls_ca = "ca", .tls_certificate = "c", .tls_key = "k"}), "");
}

TEST(Credentials, FilesAreReadOrRefused) {
  const TemporaryFolder folder;
  Credentials read;
  const auto take = [&](const std::string& flag, const std::string& content) {
    put_content(folder / "file", content);
    for (const CredentialOption& option : credential_options(read))
      if (option.flag == flag) return why_refused([&] { option.take(folder / "file"); });
    return std::string("no such option");
  };
  EXPECT_EQ(take("--tls-ca", test::kCertificate), "");
  EXPECT_EQ(take("--tls-certificate", test::kCertificate), "");
  EXPECT_EQ(take("--tls-key", test::kCertificateKey), "");
  EXPECT_EQ(take("--token-file", "secret-1\r\n"), "");
  EXPECT_EQ(read.tls_ca, test::kCertificate);
  EXPECT_EQ(read.tls_certificate, test::kCertificate);
  EXPECT_EQ(read.tls_key, test::kCertificateKey);
  EXPECT_EQ(read.token, "secret-1");
  EXPECT_NE(take("--tls-ca", test::kCertificateKey).find("--tls-ca"), std::string::npos);
  EXPECT_NE(take("--tls-key", test::kCertificate).find("--tls-key"), std::string::npos);
  EXPECT_NE(take("--tls-certificate", "").find("--tls-certificate"), std::string::npos);
  for (const std::string& text : {std::string(), std::string("\n"), std::string("two words"),
                                  std::string("a\nb"), std::string("\x80"), std::string(513, 'a')})
    EXPECT_NE(take("--token-file", text).find("--token-file"), std::string::npos) << text;
  for (const CredentialOption& option : credential_options(read))
    for (const std::string& path :
         {(folder / "absent").string(), (folder / "").string(), std::string("/dev/zero")})
      EXPECT_NE(why_refused([&] { option.take(path); }).find(std::string(option.flag) + " " + path),
                std::string::npos);
}

TEST(Credentials, EveryCallShowsTheToken) {
  test::FakeServer server;
  server.create_scene("s");
  for (const char* token : {"", "secret"}) {
    const auto palpation = v1::Palpation::NewStub(make_channel(server.address(), {.token = token}));
    {
      grpc::ClientContext context;
      v1::ListScenesResponse scenes;
      ASSERT_TRUE(palpation->ListScenes(&context, {}, &scenes).ok());
    }
    grpc::ClientContext context;
    const auto stream = palpation->WatchFinger(&context);
    v1::WatchFingerRequest request;
    request.set_scene_id("s");
    v1::FingerState state;
    ASSERT_TRUE(stream->Write(request) && stream->Read(&state));
    context.TryCancel();
    stream->Finish();
  }
  EXPECT_EQ(server.palpation.shown(), std::vector<std::string>({"", "", "Bearer secret", "Bearer secret"}));
}

}  // namespace
}  // namespace teletact::client
