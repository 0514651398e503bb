function mpc = dc_line
% made for the tests of gridfold
mpc.version = '2';
== = 100;
%	bus	type	Pd	Qd	Gs	Bs	area	Vm	Va	baseKV	zone	Vmax	Vmin
mpc.bus = [
	1	3	0	0	0	0	1	1.04	0	230	1	1.1	0.9;
	2	2	0	0	0	0	1	1.02	-2	230	2	1.1	0.9;
	3	1	120	40	2	20	2	0.98	-5	0	1	1.1	0.9;
	9	4	5	1	0	0	1	1	0	230	1	1.1	0.9;
];
%	bus	Pg	Qg	Qmax	Qmin	Vg	mBase	status	Pmax	Pmin
mpc.gen = [
	1	60	10	90	-90	1.04	150	1	140	10;
	2	50	20	60	-60	1.02	0	1	95	5;
	2	20	10	60	-60	1.02	50	1	95	5;
	2	10	0	60	-60	1.02	50	0	95	5;
];
%	fbus	tbus	r	x	b	rateA	rateB	rateC	ratio	angle	status	angmin	angmax
mpc.branch = [
	1	2	0.01	0.08	0.05	0	0	0	0	0	1	-360	360;
	2	1	0.02	0.16	0.02	0	0	0	0	0	0	-360	360;
	2	3	0.02	0.15	0.03	0	0	0	0	0	1	-360	360;
	1	3	0	0.12	0.04	0	0	0	0.97	4	1	-360	360;
];
mpc.gencost = [
	2	0	0	3	0.1	20	0;
	2	0	0	3	0.1	20	0;
	2	0	0	3	0.1	20	0;
	2	0	0	3	0.1	20	0;
];
%	fbus	tbus	status	Pf	Pt	Qf	Qt	Vf	Vt	Pmin	Pmax	QminF	QmaxF	QminT	QmaxT	loss0	loss1
mpc.dcline = [
	1	3	1	10	8.9	0	0	1.01	1	1	10	-10	10	-10	10	1	0.01;
];
