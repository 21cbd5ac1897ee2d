#include <doctest.h>

#include <initializer_list>

#include "fixed.h"
#include "pid.h"

using namespace daranti;

namespace {

constexpr uint8_t kDt = 5;

struct Loop {
  PidCoefficients coefficients;
  PidState state;
  int16_t limit;
  explicit Loop(PidGains gains, int16_t limit_ = 255)
      : coefficients(pid_prepare(gains, kDt)), limit(limit_) {}
  int16_t step(int16_t setpoint, int16_t measurement) {
    return pid_step(state, coefficients, setpoint, measurement, limit);
  }
};

}  // namespace

TEST_CASE("Clamp, approach, divide and saturate do what they say at their edges") {
  CHECK(clamp(5, -3, 3) == 3);
  CHECK(clamp(-5, -3, 3) == -3);
  CHECK(clamp(2, -3, 3) == 2);
  CHECK(magnitude(-7) == 7);
  CHECK(magnitude(7) == 7);
  CHECK(magnitude(0) == 0);
  CHECK(least(3, 4) == 3);
  CHECK(least(4, 3) == 3);
  CHECK(saturate16(32767) == 32767);
  CHECK(saturate16(32768) == 32767);
  CHECK(saturate16(-32768) == -32768);
  CHECK(saturate16(-32769) == -32768);
  CHECK(approach(0, 10, 3) == 3);
  CHECK(approach(0, -10, 3) == -3);
  CHECK(approach(9, 10, 3) == 10);
  CHECK(divide(7, 2) == 4);
  CHECK(divide(-7, 2) == -4);
  CHECK(divide(6, 4) == 2);
  CHECK(divide(5, 4) == 1);
  CHECK(divide(-5, 4) == -1);
}

TEST_CASE("Proportional gain: 10 deg of error at 5 duty/deg gives 50") {
  Loop loop({500, 0, 0, 0});
  CHECK(loop.step(1000, 0) == 50);
  CHECK(loop.step(0, 1000) == -50);
  CHECK(loop.step(700, 700) == 0);
}

TEST_CASE("The output never leaves its limit, whatever the inputs") {
  for (const int16_t limit : {0, 1, 100, 255}) {
    Loop loop({10000, 10000, 20000, 0}, limit);
    for (const int16_t setpoint : {-32768, -5000, 0, 5000, 32767}) {
      for (const int16_t measurement : {-32768, -5000, 0, 5000, 32767}) {
        for (int i = 0; i < 5; ++i) {
          const int16_t output = loop.step(setpoint, measurement);
          CHECK(output <= limit);
          CHECK(output >= -limit);
        }
      }
    }
  }
}

TEST_CASE("An error beyond 100 deg counts as 100 deg") {
  Loop loop({100, 0, 0, 0});
  CHECK(loop.step(32767, -32768) == 100);
  CHECK(loop.step(-32768, 32767) == -100);
  CHECK(loop.step(10000, 0) == 100);
  CHECK(loop.step(9900, 0) == 99);
}

TEST_CASE("Coefficients are the gains per centidegree and step, rounded") {
  const PidCoefficients c = pid_prepare({5000, 10, 20000, 15}, kDt);
  CHECK(c.kp == 32768);
  CHECK(c.ki == 5);
  CHECK(c.kd == 10240);
  CHECK(c.smooth == 4096);
  CHECK(c.track == 1489);
  CHECK(pid_prepare({9999, 350, 0, 0}, kDt).kp == 65529);
  CHECK(pid_prepare({0, 350, 0, 0}, kDt).ki == 184);
  // Half a duty rounds up: 50 duty/deg, 1.01 deg.
  Loop loop({5000, 0, 0, 0});
  CHECK(loop.step(101, 0) == 51);
}

TEST_CASE("Errors and motion are cut off at their bounds exactly") {
  Loop loop({0, 10000, 0, 0});
  loop.step(32767, -32768);
  CHECK(loop.state.integral == 10000 * loop.coefficients.ki);
  loop.step(-32768, 32767);
  CHECK(loop.state.integral == 0);
  Loop moving({0, 0, 600, 0});
  moving.step(0, 0);
  CHECK(moving.step(0, 3000) == -240);
  CHECK(moving.state.rate == 200 * 256);
  CHECK(moving.step(0, 0) == 240);
  CHECK(moving.state.rate == -200 * 256);
}

TEST_CASE("What is taken back at the limit is 5 of 55 parts of the excess") {
  for (const int16_t sign : {1, -1}) {
    Loop loop({0, 0, 0, 0}, 100);
    loop.state.integral = sign * (int32_t{255} << 20);
    loop.step(0, 0);
    // 155 duty, 2^-2, times 1489 of 2^14.
    const int32_t back = 155 * 4 * 1489 * 16;
    CHECK(loop.state.integral == sign * ((int32_t{255} << 20) - back));
  }
}

TEST_CASE("However far beyond the limit, a step takes back at most the full duty") {
  for (const int16_t sign : {1, -1}) {
    Loop loop({10000, 0, 0, 0});
    loop.state.integral = sign * (int32_t{255} << 20);
    loop.step(static_cast<int16_t>(sign * 10000), 0);
    CHECK(loop.state.integral == 0);
  }
}

TEST_CASE("Within the limit the integral stays to the last bit") {
  for (const int32_t value : {1, -1, 12345, -12345}) {
    Loop loop({0, 0, 0, 0});
    loop.state.integral = value;
    loop.step(0, 0);
    CHECK(loop.state.integral == value);
  }
}

TEST_CASE("Integral: 1 deg of error for a second at 20 duty/(deg s) gives 20") {
  Loop loop({0, 2000, 0, 0});
  int16_t output = 0;
  for (int i = 0; i <= 200; ++i) output = loop.step(100, 0);
  CHECK(output == 20);
  for (int i = 0; i < 400; ++i) output = loop.step(-100, 0);
  CHECK(output == -20);
}

TEST_CASE("The integral acts from the step after the error on") {
  Loop loop({0, 10000, 0, 0});
  CHECK(loop.step(10000, 0) == 0);
  CHECK(loop.step(10000, 0) == 50);
}

TEST_CASE("The derivative acts against motion of the measurement") {
  // 1 deg in 5 ms is 200 deg/s; unfiltered, 0.1 duty s/deg makes it 20.
  Loop loop({0, 0, 100, 0});
  CHECK(loop.step(0, 0) == 0);
  CHECK(loop.step(0, 100) == -20);
  CHECK(loop.step(0, 0) == 20);
  CHECK(loop.step(0, 0) == 0);
}

TEST_CASE("The derivative knows nothing of the setpoint") {
  Loop loop({0, 0, 20000, 0});
  loop.step(0, 0);
  CHECK(loop.step(5000, 0) == 0);
  CHECK(loop.step(-5000, 0) == 0);
}

TEST_CASE("The first measurement gives no derivative kick") {
  Loop loop({0, 0, 20000, 0});
  CHECK(loop.step(0, 3000) == 0);
  CHECK(loop.step(0, 3000) == 0);
}

TEST_CASE("The derivative's filter takes the stated share of a new rate") {
  // dt / (tau + dt) = 5 / 20: a quarter, then three quarters of that, and so on.
  Loop loop({0, 0, 400, 15});
  loop.step(0, 0);
  CHECK(loop.step(0, 100) == -20);
  CHECK(loop.step(0, 100) == -15);
  CHECK(loop.step(0, 100) == -11);
}

TEST_CASE("Motion beyond 400 deg/s counts as 400 deg/s") {
  Loop slow({0, 0, 100, 0});
  slow.step(0, 0);
  CHECK(slow.step(0, 200) == -40);
  Loop fast({0, 0, 100, 0});
  fast.step(0, 0);
  CHECK(fast.step(0, 3000) == -40);
  CHECK(fast.step(0, -3000) == 40);
}

TEST_CASE("At the limit the integral does not wind up: it leaves the limit within 0.2 s") {
  for (const int16_t sign : {1, -1}) {
    Loop loop({500, 5000, 0, 0}, 100);
    for (int i = 0; i < 2000; ++i) loop.step(static_cast<int16_t>(sign * 4000), 0);
    CHECK(sign * loop.state.integral <= int32_t{20} << 20);
    int steps = 0;
    while (sign * loop.step(0, static_cast<int16_t>(sign * 100)) > 0) ++steps;
    CHECK(steps < 40);
  }
}

TEST_CASE("Coming back from the limit, the integral is taken back with 50 ms, not at once") {
  Loop loop({0, 10000, 0, 0}, 255);
  for (int i = 0; i < 100; ++i) loop.step(10000, 0);
  const int32_t full = loop.state.integral;
  CHECK(full == int32_t{255} << 20);
  loop.limit = 100;
  loop.coefficients.ki = 0;
  loop.step(0, 0);
  // (255 - 100) * 5 / 55
  CHECK((full - loop.state.integral) / (1 << 20) == 14);
}

TEST_CASE("Limiting never turns the integral's sign") {
  for (const int16_t sign : {1, -1}) {
    Loop loop({10000, 100, 0, 0}, 10);
    loop.state.integral = sign * 1000;
    loop.step(static_cast<int16_t>(sign * 10000), 0);
    CHECK(sign * loop.state.integral >= 0);
    loop.step(static_cast<int16_t>(sign * 10000), 0);
    CHECK(sign * loop.state.integral >= 0);
  }
}

TEST_CASE("An integral that pulls away from the limit is left to act") {
  Loop loop({10000, 0, 0, 0}, 10);
  loop.state.integral = -5000;
  loop.step(10000, 0);
  CHECK(loop.state.integral == -5000);
  loop.state.integral = 5000;
  loop.step(-10000, 0);
  CHECK(loop.state.integral == 5000);
}

TEST_CASE("The integral stays within the full duty") {
  for (const int16_t sign : {1, -1}) {
    Loop loop({0, 10000, 0, 0}, 255);
    for (int i = 0; i < 500; ++i) loop.step(static_cast<int16_t>(sign * 10000), 0);
    CHECK(magnitude(loop.state.integral) <= int32_t{255} << 20);
    CHECK(loop.step(0, 0) == sign * 255);
  }
}

TEST_CASE("The same inputs give the same output: no hidden state") {
  const PidCoefficients coefficients = pid_prepare({1234, 567, 890, 20}, kDt);
  PidState a, b;
  for (int i = 0; i < 100; ++i) {
    const int16_t setpoint = static_cast<int16_t>(i * 37 % 4000);
    const int16_t measurement = static_cast<int16_t>(i * 91 % 3000);
    CHECK(pid_step(a, coefficients, setpoint, measurement, 255) ==
          pid_step(b, coefficients, setpoint, measurement, 255));
  }
}

TEST_CASE("The gains mean the same at another dt") {
  // One second of 1 deg at 20 duty/(deg s) in steps of 10 ms.
  const PidCoefficients coefficients = pid_prepare({0, 2000, 0, 0}, 10);
  PidState state;
  int16_t output = 0;
  for (int i = 0; i <= 100; ++i) output = pid_step(state, coefficients, 100, 0, 255);
  CHECK(output == 20);
  // 200 deg/s at 0.1 duty s/deg.
  const PidCoefficients damping = pid_prepare({0, 0, 100, 0}, 10);
  PidState moving;
  pid_step(moving, damping, 0, 0, 255);
  CHECK(pid_step(moving, damping, 0, 200, 255) == -20);
}

TEST_CASE("A lagging motor under proportional and derivative action does not overshoot") {
  // Speed follows the duty with 50 ms; without the derivative this overshoots.
  for (const int16_t kd : {0, 60}) {
    Loop loop({2000, 0, static_cast<int16_t>(kd * 20), 5});
    double angle = 0, speed = 0, most = 0;
    for (int i = 0; i < 400; ++i) {
      const int16_t duty = loop.step(2000, static_cast<int16_t>(angle * 100));
      speed += (duty * 0.6 - speed) * 5.0 / 50.0;
      angle += speed * 0.005;
      if (angle > most) most = angle;
    }
    CHECK(angle == doctest::Approx(20).epsilon(0.02));
    if (kd == 0) {
      CHECK(most > 20.5);
    } else {
      CHECK(most < 20.3);
    }
  }
}
