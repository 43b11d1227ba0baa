// The loop that users of FMI4j write. Arguments: a file that says what to run, a file for the results.
//
//   unit NAME PATH                   in stepping order
//   wire UNIT REFERENCE UNIT REFERENCE
//   record UNIT REFERENCE
//   run STEP COUNT SCHEME            s; Jacobi or Gauss-Seidel
//
// The results are COUNT rows of big-endian doubles, one per recorded output; printed are the loop's seconds.

import java.io.BufferedOutputStream;
import java.io.DataOutputStream;
import java.io.File;
import java.io.FileOutputStream;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import no.ntnu.ihb.fmi4j.FmiStatus;
import no.ntnu.ihb.fmi4j.importer.fmi2.CoSimulationSlave;
import no.ntnu.ihb.fmi4j.importer.fmi2.Fmu;

public final class Fmi4jLoop {
    private static final class Unit {
        final CoSimulationSlave slave;
        final List<Long> read = new ArrayList<>(), set = new ArrayList<>();
        final List<Unit> sources = new ArrayList<>();
        final List<Integer> places = new ArrayList<>(); // of what is set, among what its source reads
        long[] outputs, inputs;
        double[] values, given;

        Unit(String name, String path) throws Exception {
            slave = Fmu.from(new File(path)).asCoSimulationFmu().newInstance(name);
            check(slave.setupExperiment() && slave.enterInitializationMode(), name + ": initialization");
        }

        int reads(long reference) {
            read.add(reference);
            return read.size() - 1;
        }

        void wired() {
            outputs = read.stream().mapToLong(Long::longValue).toArray();
            inputs = set.stream().mapToLong(Long::longValue).toArray();
            values = new double[outputs.length];
            given = new double[inputs.length];
        }

        void get() {
            if (outputs.length > 0) check(slave.readReal(outputs, values) == FmiStatus.OK, "readReal");
        }

        void take() {
            for (int k = 0; k < given.length; k++) given[k] = sources.get(k).values[places.get(k)];
            if (inputs.length > 0) check(slave.writeReal(inputs, given) == FmiStatus.OK, "writeReal");
        }
    }

    private static void check(boolean done, String what) {
        if (!done) throw new IllegalStateException(what + " failed");
    }

    public static void main(String[] arguments) throws Exception {
        Map<String, Unit> byName = new LinkedHashMap<>();
        List<Unit> recorded = new ArrayList<>();
        List<Integer> places = new ArrayList<>();
        double step = 0;
        int count = 0;
        boolean sequential = false;
        for (String line : Files.readAllLines(Path.of(arguments[0]))) {
            String[] word = line.split("\t");
            switch (word[0]) {
                case "unit" -> byName.put(word[1], new Unit(word[1], word[2]));
                case "wire" -> {
                    Unit source = byName.get(word[1]), sink = byName.get(word[3]);
                    sink.set.add(Long.valueOf(word[4]));
                    sink.sources.add(source);
                    sink.places.add(source.reads(Long.parseLong(word[2])));
                }
                case "record" -> {
                    recorded.add(byName.get(word[1]));
                    places.add(byName.get(word[1]).reads(Long.parseLong(word[2])));
                }
                default -> {
                    step = Double.parseDouble(word[1]);
                    count = Integer.parseInt(word[2]);
                    sequential = word[3].equals("Gauss-Seidel");
                }
            }
        }
        List<Unit> units = List.copyOf(byName.values());
        units.forEach(Unit::wired);
        for (int n = 0; n <= units.size(); n++) { // initial values reach the end of the longest chain
            units.forEach(Unit::get);
            units.forEach(Unit::take);
        }
        for (Unit u : units) check(u.slave.exitInitializationMode(), "exitInitializationMode");
        double[][] rows = new double[count][recorded.size()];
        long begun = System.nanoTime();
        for (int n = 0; n < count; n++) {
            double t = n * step;
            if (!sequential) units.forEach(Unit::take);
            for (Unit u : units) {
                if (sequential) u.take();
                check(u.slave.doStep(t, step), "doStep");
                if (sequential) u.get();
            }
            if (!sequential) units.forEach(Unit::get);
            for (int k = 0; k < recorded.size(); k++) rows[n][k] = recorded.get(k).values[places.get(k)];
        }
        System.out.println((System.nanoTime() - begun) * 1e-9);
        for (Unit u : units) u.slave.close();
        try (DataOutputStream out = new DataOutputStream(new BufferedOutputStream(new FileOutputStream(arguments[1])))) {
            for (double[] row : rows) for (double x : row) out.writeDouble(x);
        }
    }
}
