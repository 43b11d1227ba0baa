// A unit's states, integrated by Apache Commons Math. Arguments: a file that says what to run, a file for the results.
//
//   unit NAME PATH REFERENCE...      of what is read
//   input REFERENCE VALUE...         at every step's begin and at the end; linear between them
//   alone KIND STATES INDICATORS
//   run STEP COUNT SCHEME            s
//
// The results are COUNT + 1 rows of little-endian doubles, one per reference; printed is how many state events there were.

import java.io.BufferedOutputStream;
import java.io.File;
import java.io.FileOutputStream;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.List;
import no.ntnu.ihb.fmi4j.FmiStatus;
import no.ntnu.ihb.fmi4j.importer.fmi2.Fmu;
import no.ntnu.ihb.fmi4j.importer.fmi2.ModelExchangeInstance;
import org.apache.commons.math3.ode.FirstOrderDifferentialEquations;
import org.apache.commons.math3.ode.events.EventHandler;
import org.apache.commons.math3.ode.nonstiff.DormandPrince853Integrator;

public final class Fmi4jExchange implements FirstOrderDifferentialEquations {
    static final double TOLERANCE = 1e-9, BEYOND = 1e-9; // relative; s behind a root, where an event is told of

    ModelExchangeInstance unit;
    long[] read, set = {};
    final List<double[]> inputs = new ArrayList<>();
    int states, indicators, count, events;
    double step, t, nextEvent;
    double[] x;

    static void check(boolean done, String what) {
        if (!done) throw new IllegalStateException(what + " failed");
    }

    static void check(FmiStatus status, String what) {
        check(status == FmiStatus.OK, what);
    }

    static long[] references(String[] word, int from) {
        return Arrays.stream(word, from, word.length).mapToLong(Long::parseLong).toArray();
    }

    void open(Path given) throws Exception {
        for (String line : Files.readAllLines(given)) {
            String[] word = line.split("\t");
            switch (word[0]) {
                case "unit" -> {
                    unit = Fmu.from(new File(word[2])).asModelExchangeFmu().newInstance(word[1]);
                    read = references(word, 3);
                }
                case "input" -> {
                    set = Arrays.copyOf(set, set.length + 1);
                    set[set.length - 1] = Long.parseLong(word[1]);
                    inputs.add(Arrays.stream(word, 2, word.length).mapToDouble(Double::parseDouble).toArray());
                }
                case "alone" -> {
                    states = Integer.parseInt(word[2]);
                    indicators = Integer.parseInt(word[3]);
                }
                case "run" -> {
                    step = Double.parseDouble(word[1]);
                    count = Integer.parseInt(word[2]);
                }
                default -> { } // all that is read is recorded
            }
        }
    }

    void setInputs(double at) {
        if (set.length == 0) return;
        int row = Math.min((int) (at / step), count - 1);
        double part = at / step - row;
        double[] values = inputs.stream().mapToDouble(v -> v[row] + part * (v[row + 1] - v[row])).toArray();
        check(unit.writeReal(set, values), "writeReal");
    }

    void at(double time, double[] y) {
        check(unit.setTime(time), "setTime");
        setInputs(time);
        check(unit.setContinuousStates(y), "setContinuousStates");
    }

    @Override
    public int getDimension() {
        return states;
    }

    @Override
    public void computeDerivatives(double time, double[] y, double[] slope) {
        at(time, y);
        check(unit.getDerivatives(slope), "getDerivatives");
    }

    /** In event mode when it is called, in continuous-time mode behind it. */
    void event() {
        var info = unit.getEventInfo$fmi_import();
        do {
            check(unit.newDiscreteStates(), "newDiscreteStates");
        } while (info.getNewDiscreteStatesNeeded());
        nextEvent = info.getNextEventTimeDefined() ? info.getNextEventTime() : Double.POSITIVE_INFINITY;
        check(unit.enterContinuousTimeMode(), "enterContinuousTimeMode");
        check(unit.getContinuousStates(x), "getContinuousStates");
    }

    /** Stops an integration where an indicator turns positive. */
    EventHandler indicator(int k, boolean[] met) {
        return new EventHandler() {
            private final double[] z = new double[indicators];

            @Override
            public void init(double t0, double[] y0, double end) { }

            @Override
            public double g(double time, double[] y) {
                at(time, y);
                check(unit.getEventIndicators(z), "getEventIndicators");
                return z[k];
            }

            @Override
            public Action eventOccurred(double time, double[] y, boolean increasing) {
                met[0] |= increasing;
                return increasing ? Action.STOP : Action.CONTINUE;
            }

            @Override
            public void resetState(double time, double[] y) { }
        };
    }

    void integrate(double end) {
        double[] nominal = new double[states], slope = new double[states];
        check(unit.getNominalsOfContinuousStates(nominal), "getNominalsOfContinuousStates");
        double[] absolute = Arrays.stream(nominal).map(n -> n * TOLERANCE).toArray();
        double[] relative = new double[states];
        Arrays.fill(relative, TOLERANCE);
        while (t < end) {
            boolean[] met = {false};
            double to = Math.min(end, nextEvent);
            if (states > 0 && to - t > 1e-12) {
                var integrator = new DormandPrince853Integrator(1e-16, step, absolute, relative);
                integrator.setInitialStepSize(Math.min(to - t, step) / 4);
                for (int k = 0; k < indicators; k++) integrator.addEventHandler(indicator(k, met), step / 4, 1e-13, 200);
                t = integrator.integrate(this, t, x, to, x);
            } else {
                t = to;
            }
            if (met[0]) {
                computeDerivatives(t, x, slope);
                for (int i = 0; i < states; i++) x[i] += BEYOND * slope[i];
                t += BEYOND;
                events++;
            }
            at(t, x);
            if (met[0] || t >= nextEvent) {
                check(unit.enterEventMode(), "enterEventMode");
                event();
            }
        }
    }

    double[] outputs() {
        double[] values = new double[read.length];
        check(unit.readReal(read, values), "readReal");
        return values;
    }

    double[][] run() {
        check(unit.setupExperiment() && unit.enterInitializationMode(), "initialization");
        setInputs(0);
        check(unit.exitInitializationMode(), "exitInitializationMode");
        x = new double[states];
        event();
        double[][] rows = new double[count + 1][];
        rows[0] = outputs();
        for (int k = 1; k <= count; k++) {
            integrate(k * step);
            rows[k] = outputs();
        }
        unit.close();
        return rows;
    }

    public static void main(String[] arguments) throws Exception {
        var exchange = new Fmi4jExchange();
        exchange.open(Path.of(arguments[0]));
        double[][] rows = exchange.run();
        System.out.println(exchange.events);
        try (var out = new BufferedOutputStream(new FileOutputStream(arguments[1]))) {
            for (double[] row : rows) {
                var bytes = ByteBuffer.allocate(8 * row.length).order(ByteOrder.LITTLE_ENDIAN);
                for (double value : row) bytes.putDouble(value);
                out.write(bytes.array());
            }
        }
    }
}
