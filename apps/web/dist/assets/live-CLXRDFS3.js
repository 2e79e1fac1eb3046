import{a,b,c}from"./chunk-CZZPZAXX.js";import"./chunk-5DALAH5J.js";import"./chunk-YWFMXJML.js";export{c as Live,b as LiveFigures,a as WALL};
